// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <algorithm>
#include <cstddef>

namespace earshot {

/// Time axis of late sound: the bins of a histogram one by one while single reflections stand out, later in fours.  Late energy changes by
/// the decay alone, which is known from bin to bin once it is known from four to four: a third of the memory of a source field and of all
/// that goes through it, a third of the segments to render.  Merged bins: 0 to fine() - 1 hold one bin each, the others kWide, the last one
/// what is left.
class WideningBins {
 public:
  static constexpr std::size_t kWide = 4;
  /// Single bins: 0.16, 0.08 and 0.04 s at fast, balanced and high.  A number, not a time: rooms of any size, in bins to their scale, are
  /// the same to the bit.
  static constexpr std::size_t kFine = 40;

  WideningBins() = default;
  /// Bins up to `onset_bin` are single, and kFine from there.
  explicit WideningBins(int num_bins, std::size_t onset_bin = 0)
      : bins_(static_cast<std::size_t>(num_bins)),
        fine_(std::min(bins_, kFine + onset_bin)),
        merged_(fine_ + (bins_ - fine_ + kWide - 1) / kWide) {}

  [[nodiscard]] std::size_t fine() const { return fine_; }
  [[nodiscard]] std::size_t size() const { return merged_; }
  [[nodiscard]] std::size_t merged_bin_of(std::size_t bin) const { return bin < fine_ ? bin : fine_ + (bin - fine_) / kWide; }
  /// First bin of a merged bin; of merged bin size(): the number of bins.
  [[nodiscard]] std::size_t first_bin(std::size_t merged) const {
    return merged < fine_ ? merged : std::min(bins_, fine_ + (merged - fine_) * kWide);
  }
  [[nodiscard]] std::size_t width(std::size_t merged) const { return first_bin(merged + 1) - first_bin(merged); }
  /// Middle of a merged bin, in bins.
  [[nodiscard]] double middle(std::size_t merged) const {
    return 0.5 * (static_cast<double>(first_bin(merged)) + static_cast<double>(first_bin(merged + 1)));
  }

 private:
  std::size_t bins_ = 0, fine_ = 0, merged_ = 0;
};

}  // namespace earshot
