// SPDX-License-Identifier: Apache-2.0
#include "bench/measure/statistics.h"

#include <malloc.h>
#include <unistd.h>

#include <algorithm>
#include <cmath>
#include <fstream>

#include "sim/base/errors.h"

namespace earshot {

void LogHistogram::add(double value) {
  const double octaves = value > kLowest ? std::log2(value / kLowest) : 0.0;
  const auto last = static_cast<double>(bins_.size() - 1);
  ++bins_[static_cast<std::size_t>(std::min(std::floor(octaves * kBinsPerOctave), last))];
  ++count_;
  sum_ += value;
  max_ = std::max(max_, value);
}

double LogHistogram::quantile(double fraction) const {
  if (count_ == 0) return 0;
  const auto wanted = static_cast<std::uint64_t>(std::ceil(fraction * static_cast<double>(count_)));
  std::uint64_t below = bins_[0];
  if (below >= wanted) return 0;  // too small to tell
  for (std::size_t bin = 1; bin < bins_.size(); ++bin) {
    below += bins_[bin];
    if (below >= wanted) return std::min(max_, kLowest * std::exp2(static_cast<double>(bin + 1) / kBinsPerOctave));
  }
  return max_;
}

void read_process_memory(MemorySample& sample) {
  constexpr double kMiB = 1024.0 * 1024.0;
  std::ifstream statm("/proc/self/statm");
  double all_pages = 0, resident_pages = 0;
  if (statm >> all_pages >> resident_pages) sample.resident = resident_pages * static_cast<double>(::sysconf(_SC_PAGESIZE)) / kMiB;
  const struct mallinfo2 heap = ::mallinfo2();
  sample.heap_in_use = static_cast<double>(heap.uordblks + heap.hblkhd) / kMiB;
  sample.heap_free = static_cast<double>(heap.fordblks) / kMiB;
}

Slope fit_line(std::span<const double> x, std::span<const double> y) {
  EARSHOT_EXPECT(x.size() == y.size());
  Slope fit{.points = x.size()};
  if (x.size() < 3) return fit;
  const auto n = static_cast<double>(x.size());
  double mean_x = 0, mean_y = 0;
  for (std::size_t i = 0; i < x.size(); ++i) mean_x += x[i] / n, mean_y += y[i] / n;
  double xx = 0, xy = 0;
  for (std::size_t i = 0; i < x.size(); ++i) {
    xx += (x[i] - mean_x) * (x[i] - mean_x);
    xy += (x[i] - mean_x) * (y[i] - mean_y);
  }
  if (!(xx > 0)) return fit;
  fit.per_x = xy / xx;
  fit.intercept = mean_y - fit.per_x * mean_x;
  double squares = 0, neighbours = 0, before = 0;
  for (std::size_t i = 0; i < x.size(); ++i) {
    const double residual = y[i] - (fit.intercept + fit.per_x * x[i]);
    squares += residual * residual;
    neighbours += residual * before;  // the first has no predecessor: times 0
    before = residual;
  }
  const double rho = squares > 0 ? std::clamp(neighbours / squares, 0.0, 0.99) : 0.0;
  fit.standard_error = std::sqrt(squares / (n - 2) / xx * (1 + rho) / (1 - rho));
  return fit;
}

}  // namespace earshot
