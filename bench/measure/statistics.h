// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <span>
#include <vector>

namespace earshot {

/// Counts of positive values in logarithmic bins of 2.2 %: any number of values in fixed memory, so that the watch of a long run does not
/// grow itself.  Values are taken to lie in [1e-6, 1e6]; values outside go to the end bins.
class LogHistogram {
 public:
  void add(double value);
  [[nodiscard]] std::uint64_t count() const { return count_; }
  [[nodiscard]] double max() const { return max_; }  ///< exact; 0 without values
  [[nodiscard]] double mean() const { return count_ > 0 ? sum_ / static_cast<double>(count_) : 0.0; }
  /// The value below which a fraction of the values lies, 0 < fraction <= 1: upper edge of its bin, at most max().  0 without values, and
  /// in the lowest bin.
  [[nodiscard]] double quantile(double fraction) const;

 private:
  static constexpr double kLowest = 1e-6;
  static constexpr int kBinsPerOctave = 32, kOctaves = 40;
  std::array<std::uint64_t, std::size_t{kBinsPerOctave} * kOctaves> bins_{};
  std::uint64_t count_ = 0;
  double max_ = 0, sum_ = 0;
};

/// Memory of the process, and the part of it in the scene cache.  MiB.
struct MemorySample {
  std::uint64_t steps = 0;  ///< agent steps done so far
  double seconds = 0;       ///< since the first step
  double resident = 0;      ///< /proc/self/statm
  double heap_in_use = 0;   ///< allocated with malloc or new and not given back (all arenas, mappings included)
  double heap_free = 0;     ///< given back, but held by the allocator: its resident part is fragmentation, not a leak
  double cache = 0;         ///< SceneCache::bytes()
  std::uint64_t scenes_held = 0, scenes_loaded = 0, sources_built = 0, episodes = 0;
};
/// Fills in resident, heap_in_use and heap_free.
void read_process_memory(MemorySample& sample);

/// Steps over which a growth of memory is stated.
inline constexpr double kSlopeSteps = 100'000;

/// A straight line through points, by least squares.
struct Slope {
  double per_x = 0, intercept = 0;
  /// Of per_x.  Memory is sampled more often than it changes, so residuals follow one another: with their lag-1 correlation rho the error
  /// of independent ones is multiplied by sqrt((1 + rho) / (1 - rho)) (first-order autoregression; von Storch and Zwiers 1999, eq. 6.26).
  double standard_error = 0;
  std::size_t points = 0;
};
/// x, y of equal size.  Fewer than three points or equal x: all zero but `points`.
Slope fit_line(std::span<const double> x, std::span<const double> y);

}  // namespace earshot
