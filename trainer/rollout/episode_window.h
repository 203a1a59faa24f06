// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <array>
#include <deque>
#include <span>
#include <vector>

#include "envs/task/av_nav_task.h"

namespace earshot {

/// Sums over finished episodes, in double; the same layout on every worker, so that they add up by all-reduce.
struct EpisodeSums {
  enum Field { count, success, spl, soft_spl, sna, dtg, reward, steps, collisions, stopped, num_fields };
  std::array<double, num_fields> values{};

  void add(const EpisodeMetrics& metrics);
  /// NaN without an episode.
  [[nodiscard]] double mean(Field field) const;
};

/// Means over the last episodes (about 200) of all workers.  Summed anew each time: nothing is ever subtracted, so rounding does not build
/// up over a week.
class EpisodeWindow {
 public:
  void push(const EpisodeSums& sums);
  [[nodiscard]] EpisodeSums total() const;

  /// All sums in order, [pushes, num_fields], for restore().
  [[nodiscard]] std::vector<double> state() const;
  /// num_fields: numbers in each sum of the state; sums of an older program have fewer, and count 0 for what it did not sum.  Throws
  /// InputError for invalid values.
  void restore(std::span<const double> state, int num_fields = EpisodeSums::num_fields);

 private:
  std::deque<EpisodeSums> recent_;
};

}  // namespace earshot
