// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <array>
#include <cmath>
#include <memory>
#include <numbers>
#include <random>
#include <vector>

#include "tests/support/acoustics/radiosity.h"
#include "tests/support/acoustics/rooms.h"

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

/// A box with two hard walls across x and soft ones all round.
struct MirrorRoom {
  std::array<double, 3> size_m, source, listener;
  double hard, soft;  ///< absorption of the walls across x, of all others

  /// Energies of all images (Allen and Berkley 1979) but the first, from its arrival on.
  [[nodiscard]] std::vector<double> images(double bin_s, double length_s) const {
    const double per_area = 1 / (16 * std::numbers::pi * std::numbers::pi);
    std::array<std::vector<std::array<double, 2>>, 3> rows;  // offset, fraction kept
    const double first_m = distance_m(), reach_m = first_m + length_s * rooms::kSpeedMPerS;
    for (std::size_t axis = 0; axis < 3; ++axis) {
      const int count = static_cast<int>(reach_m / size_m[axis]) + 2;
      for (int n = -count; n <= count; ++n) {
        const double at = n * size_m[axis] + (n % 2 == 0 ? source[axis] : size_m[axis] - source[axis]);
        const double kept = std::pow(1 - (axis == 0 ? hard : soft), std::abs(n));
        if (kept > 1e-9) rows[axis].push_back({at - listener[axis], kept});
      }
    }
    std::vector<double> series(static_cast<std::size_t>(length_s / bin_s), 0.0);
    for (const auto& x : rows[0])
      for (const auto& y : rows[1])
        for (const auto& z : rows[2]) {
          const double r = std::sqrt(x[0] * x[0] + y[0] * y[0] + z[0] * z[0]);
          const auto bin = static_cast<std::size_t>((r - first_m) / rooms::kSpeedMPerS / bin_s);
          if (r > first_m + 1e-9 && bin < series.size()) series[bin] += per_area * x[1] * y[1] * z[1] / (r * r);
        }
    return series;
  }
  [[nodiscard]] double distance_m() const {
    double sum = 0;
    for (std::size_t axis = 0; axis < 3; ++axis) sum += (source[axis] - listener[axis]) * (source[axis] - listener[axis]);
    return std::sqrt(sum);
  }
  [[nodiscard]] std::shared_ptr<const Scene> scene() const {
    std::array<Material, 6> walls = rooms::uniform_walls(soft, 0);
    walls[0] = walls[1] = rooms::uniform_walls(hard, 0)[0];
    return rooms::box(size_m[0], size_m[1], size_m[2], walls);
  }
  [[nodiscard]] static glm::vec3 place(const std::array<double, 3>& p) { return rooms::point(p[0], p[1], p[2]); }
};

/// Rooms drawn at random behind a fixed first one, whose sound between the hard walls decays far slower than that of a diffuse field:
/// images have a T20 of 1.22 s.
inline std::vector<MirrorRoom> mirror_rooms(int count) {
  std::mt19937 draw(4);
  const auto uniform = [&](double from, double to) { return std::uniform_real_distribution<double>(from, to)(draw); };
  std::vector<MirrorRoom> all;
  for (int number = 0; number < count; ++number) {
    MirrorRoom& room = all.emplace_back(MirrorRoom{{6, 5, 3}, {1.7, 1.4, 1.2}, {4.1, 3.0, 1.5}, 0.05, 0.6});
    if (number == 0) continue;
    room.size_m = {uniform(4, 8), uniform(3, 6), uniform(2.5, 4)};
    for (std::size_t axis = 0; axis < 3; ++axis) {
      room.source[axis] = room.size_m[axis] * uniform(0.15, 0.4);
      room.listener[axis] = room.size_m[axis] * uniform(0.55, 0.85);
    }
    room.hard = uniform(0.03, 0.15), room.soft = uniform(0.5, 0.9);
  }
  return all;
}

}  // namespace earshot::image_sum
