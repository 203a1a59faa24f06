// SPDX-License-Identifier: Apache-2.0
#include "sim/acoustics/model/plane_cells.h"

#include <algorithm>
#include <cmath>
#include <deque>
#include <glm/common.hpp>
#include <map>
#include <mutex>
#include <tuple>

#include "sim/acoustics/core/sampling.h"
#include "sim/acoustics/model/acoustic_scene.h"
#include "sim/base/denormals.h"
#include "sim/base/memory_bytes.h"
#include "sim/base/random.h"

namespace earshot {
namespace {

using Key = std::tuple<std::int64_t, std::int64_t, std::int64_t, std::uint64_t>;  // cell, and what else decides

std::vector<PlaneSequence> find_sequences(const AcousticScene& scene, glm::vec3 lower, float cell_m) {
  const FlushDenormals flush;
  std::vector<PlaneSequence> sequences;
  const auto shift = RandomStream(scene.config().seed, Purpose::source_ray).bits4(1);
  const SphereSequence directions(shift[0], shift[1]);
  const Bounds& bounds = scene.scene().bounds();
  for (int ray = 0; ray < scene.config().early_candidate_rays; ++ray) {
    // Steps of 1/g, 1/g^2 and 1/g^3 with g^4 = g + 1, in units of 2^-32, spread any number of points evenly, as SphereSequence does in two
    // dimensions.
    const auto at = [&](std::uint32_t step) { return RandomStream::to_unit(shift[2] + static_cast<std::uint32_t>(ray) * step); };
    const glm::vec3 origin = lower + cell_m * glm::vec3(at(3518319155u), at(2882110345u), at(2360945575u));
    append_sequences(scene, glm::clamp(origin, bounds.lower, bounds.upper), directions.direction(static_cast<std::uint32_t>(ray)),
                     sequences);
  }
  std::sort(sequences.begin(), sequences.end());
  sequences.erase(std::unique(sequences.begin(), sequences.end()), sequences.end());
  sequences.shrink_to_fit();
  return sequences;
}

}  // namespace

void append_sequences(const AcousticScene& scene, glm::vec3 origin, glm::vec3 direction, std::vector<PlaneSequence>& sequences) {
  PlaneSequence sequence;
  while (sequence.order < scene.image_order()) {
    const Hit hit = scene.scene().rays().intersect(origin, direction);
    if (!hit.valid()) break;
    const std::uint32_t plane = scene.plane_of_triangle()[hit.triangle];
    const auto order = static_cast<std::size_t>(sequence.order);
    if (order > 0 && sequence.plane[order - 1] == plane) break;
    sequence.plane[order] = plane;
    ++sequence.order;
    sequences.push_back(sequence);
    origin = offset_from_surface(hit.position, hit.normal);
    direction = mirror_direction(direction, hit.normal);
  }
}

struct PlaneCells::Cells {
  std::mutex mutex;
  std::map<Key, std::shared_ptr<const std::vector<PlaneSequence>>> known;
  std::deque<Key> by_age;
  std::size_t bytes = 0;  ///< of the sequences
};

PlaneCells::PlaneCells() : cells_(std::make_unique<Cells>()) {}
PlaneCells::~PlaneCells() = default;

std::shared_ptr<const std::vector<PlaneSequence>> PlaneCells::of(const AcousticScene& scene, glm::vec3 point) const {
  const float cell_m = std::clamp(scene.diagonal_m() / 16.f, 1e-6f, kCellM);
  const glm::dvec3 cell = glm::floor(glm::dvec3(point) / double{cell_m});
  const Key key{static_cast<std::int64_t>(cell.x), static_cast<std::int64_t>(cell.y), static_cast<std::int64_t>(cell.z),
                scene.config().seed};
  {
    const std::lock_guard lock(cells_->mutex);
    if (const auto found = cells_->known.find(key); found != cells_->known.end()) return found->second;
  }
  // Outside of the lock: two threads may find the same twice.
  auto sequences = std::make_shared<const std::vector<PlaneSequence>>(find_sequences(scene, glm::vec3(cell * double{cell_m}), cell_m));
  const std::lock_guard lock(cells_->mutex);
  const auto [place, added] = cells_->known.emplace(key, sequences);
  if (!added) return place->second;
  cells_->by_age.push_back(key);
  cells_->bytes += bytes_of(*sequences);
  if (cells_->by_age.size() > kMaxCells) {
    const auto oldest = cells_->known.find(cells_->by_age.front());
    cells_->bytes -= bytes_of(*oldest->second);
    cells_->known.erase(oldest);
    cells_->by_age.pop_front();
  }
  return sequences;
}

std::size_t PlaneCells::size() const {
  const std::lock_guard lock(cells_->mutex);
  return cells_->known.size();
}

std::size_t PlaneCells::bytes() const {
  constexpr std::size_t per_cell = 128;  // node of the map, key by age, block of the vector
  const std::lock_guard lock(cells_->mutex);
  return cells_->bytes + per_cell * cells_->known.size();
}

}  // namespace earshot
