// SPDX-License-Identifier: Apache-2.0
#include <gtest/gtest.h>

#include <algorithm>
#include <array>
#include <glm/geometric.hpp>
#include <memory>
#include <vector>

#include "sim/acoustics/core/sampling.h"
#include "sim/acoustics/geometry/field_grid.h"
#include "sim/base/random.h"
#include "tests/support/acoustics/divided_room.h"

/// Cells beside a wall that is nearly closed, wherever the wall lies in the grid: none holds air of both sides.
namespace earshot {
namespace {

using rooms::point;
using slits::DividedRoom;

/// Metres of the way of diffusely reflected rays in each cell, before and behind the wall, but for segments through the gap.
std::array<std::vector<double>, 2> way_by_side(const DividedRoom& room, const Scene& scene, const FieldGrid& grid, std::uint32_t number) {
  std::array<std::vector<double>, 2> way_m{std::vector<double>(grid.size()), std::vector<double>(grid.size())};
  std::vector<FieldGrid::Crossing> crossings;
  for (std::uint32_t ray = 0; ray < 6000; ++ray) {
    const RandomStream random(12, Purpose::test, number, ray);
    const auto u = random.uniform4(0);
    glm::vec3 from = point(DividedRoom::kLength * static_cast<double>(u[0]), DividedRoom::kWidth * static_cast<double>(u[1]),
                           DividedRoom::kHeight * static_cast<double>(u[2]));
    glm::vec3 direction = sphere_direction(u[3], random.uniform(100)), last_normal(0);
    std::uint32_t cell = FieldGrid::no_cell;
    for (std::uint32_t bounce = 0; bounce < 6; ++bounce) {
      const Hit hit = scene.rays().intersect(from, direction);
      if (!hit.valid()) break;
      crossings.clear();
      cell = grid.cross(from, direction, hit.distance_m, crossings, cell);
      const glm::vec3 normal = glm::dot(hit.normal, direction) > 0 ? -hit.normal : hit.normal;
      const double start_m = room.behind(from + 1e-3f * last_normal), end_m = room.behind(hit.position + 1e-3f * normal);
      for (const FieldGrid::Crossing& crossing : crossings)
        if (start_m * end_m > 0) way_m[end_m > 0 ? 1 : 0][crossing.cell] += static_cast<double>(crossing.leave_m - crossing.enter_m);
      from = offset_from_surface(hit.position, normal);
      const auto v = random.uniform4(bounce + 1);
      direction = sphere_direction(v[0], v[1]);
      if (glm::dot(direction, normal) < 0) direction = -direction;
      last_normal = normal;
    }
  }
  return way_m;
}

// A slit of 2 cm lets -25 dB or so through: what a cell holds of the other side must be far below that.
TEST(FieldGrid, CellsDoNotStraddleAWallHoweverTheGridLies) {
  double sum = 0;
  for (std::uint32_t number = 0; number < 40; ++number) {
    const auto [room, cell_m] = DividedRoom::drawn(number);
    const auto scene = room.scene();
    const FieldGrid grid(*scene, cell_m);
    const auto way_m = way_by_side(room, *scene, grid, number);
    double other = 0, all = 0;
    for (std::uint32_t cell = 0; cell < grid.size(); ++cell) {
      other += std::min(way_m[0][cell], way_m[1][cell]);
      all += way_m[0][cell] + way_m[1][cell];
    }
    EXPECT_LT(other, 1.5e-4 * all) << number << ": wall from " << room.x0 << " to " << room.x1 << ", cells of " << cell_m << " m";
    sum += other / all;
    for (const FieldGrid::Passage& passage : grid.passages()) {
      const double first = way_m[1][passage.first] - way_m[0][passage.first], second = way_m[1][passage.second] - way_m[0][passage.second];
      EXPECT_GE(first * second, 0) << number << ": a passage through the wall, cells " << passage.first << " and " << passage.second;
    }
  }
  std::printf("in the mean %.2g of the way in cells of the other side\n", sum / 40);
  EXPECT_LT(sum / 40, 4e-5);
}

}  // namespace
}  // namespace earshot
