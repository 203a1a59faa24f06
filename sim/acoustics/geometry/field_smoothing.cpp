// SPDX-License-Identifier: Apache-2.0
#include "sim/acoustics/geometry/field_smoothing.h"

#include <algorithm>
#include <cstring>
#include <glm/geometric.hpp>
#include <span>

namespace earshot {
namespace {

/// Fraction of the difference in density that two whole neighbours exchange in a sweep: 1/8 leaves a quarter where it is.
constexpr float kExchange = 1.f / 8;
constexpr float kNeighbours = 6;
/// Sound has met walls often enough to go in all directions after so many mean free paths.
constexpr double kFirstPaths = 5;
constexpr double kFractionOfTime = 0.04;

/// Eight floats as the compilers' own vector: left to themselves, they jam the loop over neighbours into the one over lanes.
constexpr std::size_t kLanes = 8;
using Vector [[gnu::vector_size(kLanes * sizeof(float))]] = float;

}  // namespace

FieldSmoothing::FieldSmoothing(const FieldGrid& grid) {
  const glm::vec3 edge_m = grid.edge_m();
  edge2_m2_ = glm::dot(edge_m, edge_m) / 3.0;
  const std::span<const FieldGrid::Passage> passages = grid.passages();
  const std::size_t cells = grid.size();
  const auto open_m3 = [&](const FieldGrid::Passage& p) {
    return p.openness * std::min(grid.volume_m3(p.first), grid.volume_m3(p.second));
  };
  std::vector<float> around(cells, 0.f);
  for (const FieldGrid::Passage& p : passages) {
    around[p.first] += open_m3(p) / grid.volume_m3(p.first);
    around[p.second] += open_m3(p) / grid.volume_m3(p.second);
  }
  std::vector<std::vector<Exchange>> from(cells);
  for (std::uint32_t i = 0; i < cells; ++i) from[i].push_back({i, 1.f});
  for (const FieldGrid::Passage& p : passages) {
    // Small pieces may have more than six neighbours: the weight of their own value must stay positive.
    const float exchanged_m3 = kExchange * open_m3(p) * kNeighbours / std::max({kNeighbours, around[p.first], around[p.second]});
    from[p.first].push_back({p.second, exchanged_m3 / grid.volume_m3(p.second)});
    from[p.second].push_back({p.first, exchanged_m3 / grid.volume_m3(p.first)});
    from[p.first][0].fraction -= exchanged_m3 / grid.volume_m3(p.first);
    from[p.second][0].fraction -= exchanged_m3 / grid.volume_m3(p.second);
  }
  begin_.push_back(0);
  for (const std::vector<Exchange>& of_cell : from) {
    from_.insert(from_.end(), of_cell.begin(), of_cell.end());
    begin_.push_back(static_cast<std::uint32_t>(from_.size()));
  }
}

int FieldSmoothing::sweeps_at(double time_s, double mean_free_path_m, double speed_of_sound_m_per_s) const {
  if (!(mean_free_path_m > 0)) return 0;
  const double diffusion = mean_free_path_m * speed_of_sound_m_per_s / 3;
  // A sweep spreads by a variance of 2 * kExchange edges^2 along each axis; diffusion by 2 D t.
  const double sweep_m2 = 2 * kExchange * edge2_m2_, sweep_s = sweep_m2 / (2 * diffusion);
  const double by_time = kFractionOfTime * (time_s - kFirstPaths * mean_free_path_m / speed_of_sound_m_per_s) / sweep_s;
  const double by_spread = 0.25 * mean_free_path_m * mean_free_path_m / sweep_m2;
  return static_cast<int>(std::clamp(std::min(by_time, by_spread), 0.0, double{kMaxSweeps}));
}

template <std::size_t Vectors>
void FieldSmoothing::sum_neighbours(std::uint32_t cell, std::size_t width, const float* rows, float* to) const {
  Vector sum[Vectors] = {};
  for (std::uint32_t e = begin_[cell]; e < begin_[cell + 1]; ++e) {
    const float* from = rows + from_[e].cell * width;
    for (std::size_t i = 0; i < Vectors; ++i) {
      Vector values;
      std::memcpy(&values, from + i * kLanes, sizeof values);
      sum[i] += from_[e].fraction * values;
    }
  }
  std::memcpy(to, sum, sizeof sum);
}

void FieldSmoothing::sweep(int times, std::size_t width, const std::vector<std::uint32_t>& active, std::vector<float>& rows,
                           std::vector<float>& spare) const {
  constexpr std::size_t kMany = 4;  // vectors that stay in registers
  spare.resize(rows.size());
  for (int time = 0; time < times; ++time) {
    for (const std::uint32_t cell : active) {
      float* to = &spare[cell * width];
      std::size_t i = 0;
      for (; i + kMany * kLanes <= width; i += kMany * kLanes) sum_neighbours<kMany>(cell, width, rows.data() + i, to + i);
      for (; i < width; i += kLanes) sum_neighbours<1>(cell, width, rows.data() + i, to + i);
    }
    rows.swap(spare);
  }
}

std::vector<std::uint32_t> FieldSmoothing::reachable(std::vector<bool> marked) const {
  std::vector<std::uint32_t> stack;
  for (std::uint32_t cell = 0; cell < marked.size(); ++cell)
    if (marked[cell]) stack.push_back(cell);
  while (!stack.empty()) {
    const std::uint32_t cell = stack.back();
    stack.pop_back();
    for (std::uint32_t e = begin_[cell]; e < begin_[cell + 1]; ++e) {
      const std::uint32_t next = from_[e].cell;
      if (marked[next]) continue;
      marked[next] = true;
      stack.push_back(next);
    }
  }
  std::vector<std::uint32_t> cells;
  for (std::uint32_t cell = 0; cell < marked.size(); ++cell)
    if (marked[cell]) cells.push_back(cell);
  return cells;
}

}  // namespace earshot
