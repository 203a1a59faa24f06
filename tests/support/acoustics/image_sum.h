// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cmath>
#include <numbers>
#include <vector>

#include "tests/support/acoustics/radiosity.h"

/// All image sources of a box with one absorption (Allen and Berkley 1979), on their own: truth for rooms of mirrors.
namespace earshot::image_sum {

/// Energy per bin from emission on, order `from_order` upward, paths up to the length of the series.
inline std::vector<double> energy_series(const radiosity::Point& size_m, double absorption, const radiosity::Point& source,
                                         const radiosity::Point& listener, double bin_s, double length_s, int from_order = 0,
                                         double speed_m_per_s = 343.0) {
  const double reach_m = length_s * speed_m_per_s;
  std::vector<double> series(static_cast<std::size_t>(std::lround(length_s / bin_s)), 0.0);
  // Along each axis image n sits at n L + (even n: s, odd n: L - s) and has met |n| walls.
  struct Image {
    double offset_m;
    int order;
  };
  std::vector<Image> images[3];
  int longest = 0;
  for (int axis = 0; axis < 3; ++axis) {
    const int count = static_cast<int>(reach_m / size_m[axis]) + 2;
    longest += count;
    for (int n = -count; n <= count; ++n) {
      const double at = n * size_m[axis] + (n % 2 == 0 ? source[axis] : size_m[axis] - source[axis]);
      images[axis].push_back({at - listener[axis], std::abs(n)});
    }
  }
  std::vector<double> reflected(static_cast<std::size_t>(longest) + 1);
  for (std::size_t n = 0; n < reflected.size(); ++n) reflected[n] = std::pow(1 - absorption, static_cast<double>(n));
  const double per_area = 1 / (16 * std::numbers::pi * std::numbers::pi);
  for (const Image& x : images[0])
    for (const Image& y : images[1]) {
      const double xy2 = x.offset_m * x.offset_m + y.offset_m * y.offset_m;
      if (xy2 > reach_m * reach_m) continue;
      for (const Image& z : images[2]) {
        const double r2 = xy2 + z.offset_m * z.offset_m;
        const int order = x.order + y.order + z.order;
        if (r2 >= reach_m * reach_m || order < from_order) continue;
        const auto bin = static_cast<std::size_t>(std::sqrt(r2) / speed_m_per_s / bin_s);
        if (bin < series.size()) series[bin] += per_area * reflected[static_cast<std::size_t>(order)] / r2;
      }
    }
  return series;
}

}  // namespace earshot::image_sum
