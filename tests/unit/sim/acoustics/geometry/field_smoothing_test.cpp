// SPDX-License-Identifier: Apache-2.0
#include "sim/acoustics/geometry/field_smoothing.h"

#include <gtest/gtest.h>

#include <cmath>

#include "sim/base/random.h"
#include "tests/support/acoustics/rooms.h"

namespace earshot {
namespace {

constexpr std::size_t kWidth = 8;

using rooms::divided_box;

std::vector<std::uint32_t> all_cells(const FieldGrid& grid, const FieldSmoothing& smoothing) {
  return smoothing.reachable(std::vector<bool>(grid.size(), true));
}

std::vector<float> random_rows(const FieldGrid& grid, std::uint32_t seed) {
  std::vector<float> rows(grid.size() * kWidth);
  for (std::uint32_t i = 0; i < rows.size(); ++i) rows[i] = RandomStream(seed, Purpose::test, i).uniform4(0)[0];
  return rows;
}

TEST(FieldSmoothing, KeepsTheEnergyAndAUniformDensity) {
  const auto room = divided_box(1);
  const FieldGrid grid(*room, 0.6f);
  const FieldSmoothing smoothing(grid);
  const std::vector<std::uint32_t> active = all_cells(grid, smoothing);
  ASSERT_EQ(active.size(), grid.size());
  std::vector<float> rows = random_rows(grid, 1), spare;
  const auto sum = [&](std::size_t lane) {
    double energy = 0;
    for (std::size_t cell = 0; cell < grid.size(); ++cell) energy += double{rows[cell * kWidth + lane]};
    return energy;
  };
  const double before = sum(3);
  smoothing.sweep(8, kWidth, active, rows, spare);
  EXPECT_NEAR(sum(3) / before, 1.0, 1e-6);  // floats round each of some hundred cells eight times, either way

  for (std::uint32_t cell = 0; cell < grid.size(); ++cell)
    for (std::size_t lane = 0; lane < kWidth; ++lane) rows[cell * kWidth + lane] = 3.f * grid.volume_m3(cell);
  smoothing.sweep(8, kWidth, active, rows, spare);
  for (std::uint32_t cell = 0; cell < grid.size(); ++cell) EXPECT_NEAR(rows[cell * kWidth] / grid.volume_m3(cell), 3.f, 1e-5f) << cell;
}

TEST(FieldSmoothing, PassesGapsButNoWall) {
  for (const double gap_m : {0.0, 1.0}) {
    const auto room = divided_box(gap_m);
    const FieldGrid grid(*room, 1.f);
    const FieldSmoothing smoothing(grid);
    std::array<FieldGrid::CellWeight, 8> fractions;
    const std::size_t near = grid.blend(rooms::point(0.5, 2, 1.5), fractions);
    std::vector<float> rows(grid.size() * kWidth, 0.f), spare;
    std::vector<bool> lit(grid.size(), false);
    for (std::size_t i = 0; i < near; ++i) {
      rows[fractions[i].cell * kWidth] = 1.f;
      lit[fractions[i].cell] = true;
    }
    smoothing.sweep(8, kWidth, smoothing.reachable(lit), rows, spare);
    float behind = 0, beside = 0;
    const std::size_t far = grid.blend(rooms::point(3.5, 3.5, 1.5), fractions);
    for (std::size_t i = 0; i < far; ++i) behind += rows[fractions[i].cell * kWidth];
    const std::size_t same = grid.blend(rooms::point(1.5, 2, 1.5), fractions);
    for (std::size_t i = 0; i < same; ++i) beside += rows[fractions[i].cell * kWidth];
    EXPECT_GT(beside, 0.f);
    if (gap_m == 0)
      EXPECT_EQ(behind, 0.f);
    else
      EXPECT_GT(behind, 0.f);
  }
}

/// Each sweep moves an eighth of a cell's energy to each of six neighbours: a random walk whose variance along an axis grows by
/// 2 / 8 edges^2.  21 cells of 1 m keep four steps from the walls.
TEST(FieldSmoothing, SpreadsByAQuarterOfACellSquaredASweep) {
  const Material wall = Material::uniform("wall", 0.2f, 1.f);
  const auto room = rooms::box(21, 21, 21, {wall, wall, wall, wall, wall, wall});
  const FieldGrid grid(*room, 1.f);
  ASSERT_EQ(grid.size(), 9261u);
  const FieldSmoothing smoothing(grid);
  const auto cell_at = [](int x, int y, int z) { return static_cast<std::size_t>((x * 21 + y) * 21 + z); };
  std::vector<float> rows(grid.size() * kWidth, 0.f), spare;
  rows[cell_at(10, 10, 10) * kWidth] = 1.f;
  smoothing.sweep(4, kWidth, all_cells(grid, smoothing), rows, spare);
  double sum = 0, variance[3] = {};
  for (int x = 0; x < 21; ++x)
    for (int y = 0; y < 21; ++y)
      for (int z = 0; z < 21; ++z) {
        const double energy = double{rows[cell_at(x, y, z) * kWidth]};
        sum += energy;
        variance[0] += energy * (x - 10) * (x - 10);
        variance[1] += energy * (y - 10) * (y - 10);
        variance[2] += energy * (z - 10) * (z - 10);
      }
  EXPECT_NEAR(sum, 1.0, 1e-6);
  // Cells at the walls see their neighbours through points near the surface; the middle ones through their centres: exact but for floats.
  for (const double value : variance) EXPECT_NEAR(value, 4 * 0.25, 1e-5);
}

/// <w, K x / V> = <K w, x / V>: what FieldProbes rests on.
TEST(FieldSmoothing, IsItsOwnTranspose) {
  const auto room = divided_box(1);
  const FieldGrid grid(*room, 0.8f);
  const FieldSmoothing smoothing(grid);
  const std::vector<std::uint32_t> active = all_cells(grid, smoothing);
  const std::vector<float> energy = random_rows(grid, 2), weights = random_rows(grid, 3);
  std::vector<float> smooth_energy = energy, smooth_weights = weights, spare;
  smoothing.sweep(3, kWidth, active, smooth_energy, spare);
  smoothing.sweep(3, kWidth, active, smooth_weights, spare);
  double left = 0, right = 0;
  for (std::uint32_t cell = 0; cell < grid.size(); ++cell) {
    left += double{weights[cell * kWidth]} * smooth_energy[cell * kWidth] / grid.volume_m3(cell);
    right += double{smooth_weights[cell * kWidth]} * energy[cell * kWidth] / grid.volume_m3(cell);
  }
  EXPECT_NEAR(left / right, 1.0, 1e-5);
}

/// Edges of 1 m, mean free path 3 m, 343 m/s: D = 343 m^2/s, a sweep stands for 0.25 / (2 D) = 0.3644 ms; the fifth path ends at 43.73 ms.
TEST(FieldSmoothing, SweepsFollowDiffusion) {
  const Material wall = Material::uniform("wall", 0.2f, 1.f);
  const auto room = rooms::box(6, 5, 4, {wall, wall, wall, wall, wall, wall});
  const FieldGrid grid(*room, 1.f);
  const FieldSmoothing smoothing(grid);
  EXPECT_EQ(smoothing.sweeps_at(0.0, 3, 343), 0);
  EXPECT_EQ(smoothing.sweeps_at(0.052, 3, 343), 0);  // 0.04 * 8.27 ms / 0.3644 ms = 0.91
  EXPECT_EQ(smoothing.sweeps_at(0.054, 3, 343), 1);  // 1.13
  EXPECT_EQ(smoothing.sweeps_at(0.100, 3, 343), 6);  // 6.18
  EXPECT_EQ(smoothing.sweeps_at(2.0, 3, 343), 8);
  EXPECT_EQ(smoothing.sweeps_at(2.0, 1.5, 343), 2);  // half a mean free path: 0.75^2 / 0.25 = 2.25
  EXPECT_EQ(smoothing.sweeps_at(2.0, 0, 343), 0);    // no walk met a wall
}

}  // namespace
}  // namespace earshot
