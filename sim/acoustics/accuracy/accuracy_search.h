// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <optional>
#include <span>
#include <string>
#include <vector>

#include "sim/acoustics/accuracy/accuracy_reference.h"
#include "sim/acoustics/accuracy/accuracy_request.h"
#include "sim/acoustics/accuracy/accuracy_trial.h"

namespace earshot {

inline constexpr double kAccuracyMargin = 0.85;  ///< of the target, within which a prediction has to be: places are few

/// Images and edges that a candidate computes, from few to many.  1: as `fast`.
inline constexpr std::size_t kNumEarlyLevels = 4, kUsualEarlyLevel = 1;
void set_early_level(std::size_t level, AcousticConfig& config);

/// Tries candidates at every site of a request, from cheap to dear, and keeps what it saw.  Not thread-safe.
class AccuracySearch {
 public:
  /// references: one per site.  tried: is added to.  All must outlive the search.
  AccuracySearch(const AccuracyRequest& request, std::span<const AccuracyReference> references, std::vector<AccuracyChoice>& tried)
      : request_(request), references_(references), tried_(tried), best_ms_(request.most_ms) {}

  /// Rays from the listener, and from both ends; four times as many until they do, then half of that.  early: the rest of the config.
  void listener_rays(const AcousticConfig& early);
  void both_ends(const AcousticConfig& early);
  /// Two fields per site that are refined, tried after each step; the worse one counts.
  void source_field(const AcousticConfig& early, float cell_m);
  /// The best so far with images of lower orders, as long as it keeps the target.
  void fewer_images();

  /// The cheapest within kAccuracyMargin of the target so far.
  [[nodiscard]] std::optional<std::size_t> best() const { return best_; }

 private:
  struct RayLadder;
  void climb(const char* method, const RayLadder& ladder);
  AccuracyChoice try_at_all(const std::string& method, const AcousticConfig& config) const;
  double record(AccuracyChoice choice);
  [[nodiscard]] bool is_biased(const AccuracyChoice& choice, double last_used) const;

  const AccuracyRequest& request_;
  std::span<const AccuracyReference> references_;
  std::vector<AccuracyChoice>& tried_;
  std::optional<std::size_t> best_;
  double best_ms_;
};

}  // namespace earshot
