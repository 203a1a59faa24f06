// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstddef>
#include <vector>

#include "datasets/response_index.h"

namespace earshot {

/// Ranges over which a property of the drawn responses is uniform; empty: as it is in the corpus.
struct WishedRanges {
  std::vector<float> rt60_s;  ///< low, high, of t20_mid_s
  std::vector<float> drr_db;  ///< low, high
  [[nodiscard]] bool is_empty() const { return rt60_s.empty() && drr_db.empty(); }
};

/// Draws responses of a corpus so that each tenth of a wished range comes equally often.  Responses outside of a range, or whose property
/// is unknown, are not drawn.  With both ranges, weights are fitted to both in turn (iterative proportional fitting, Deming and Stephan
/// 1940), since the two properties depend on each other.  Immutable, safe from any thread.
class WishedResponses {
 public:
  static constexpr std::size_t kParts = 10;

  /// Throws InputError: a tenth of a range without a response, or ranges that no weights fit within 1 %.
  WishedResponses(const ResponseIndex& index, const WishedRanges& wished);
  /// fraction: in [0, 1), uniform.
  [[nodiscard]] std::size_t draw(float fraction) const;

 private:
  std::vector<std::size_t> responses_;
  std::vector<double> until_;  ///< of each of them: sum of the weights up to it
};

}  // namespace earshot
