// SPDX-License-Identifier: Apache-2.0
#include "sim/acoustics/model/air_points.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <glm/geometric.hpp>

namespace earshot {
namespace {

constexpr std::uint32_t kCellsX = 4, kCellsY = 2, kCellsZ = 4, kCells = kCellsX * kCellsY * kCellsZ, kTriesPerCell = 12;
constexpr float kMinHeightM = 1.2f;
constexpr float kMinWidthM = 0.8f;                         // more than a wardrobe
constexpr double kSurveyStepM = 0.8, kSurveyLayerM = 2.5;  // rooms are this wide at least twice, and so high
constexpr double kMaxPlaces = 1024;

/// The bounds; a flat scene has its air above it.
Bounds box_of_air(const AcousticSurfaces& surfaces) {
  Bounds box = surfaces.scene().bounds();
  const glm::vec3 size = box.upper - box.lower;
  box.upper.y = box.lower.y + std::max(size.y, 0.01f * std::max(size.x, size.z));
  return box;
}

}  // namespace

bool has_height(const AcousticSurfaces& surfaces, glm::vec3 point) {
  const EmbreeScene& rays = surfaces.scene().rays();
  const Hit down = rays.intersect(point, {0, -1, 0});
  return down.valid() && down.distance_m + rays.intersect(point, {0, 1, 0}).distance_m >= kMinHeightM;
}

bool is_room(const AcousticSurfaces& surfaces, glm::vec3 point) {
  const EmbreeScene& rays = surfaces.scene().rays();
  const auto free_m = [&](glm::vec3 axis) { return rays.intersect(point, axis).distance_m + rays.intersect(point, -axis).distance_m; };
  return has_height(surfaces, point) && free_m({1, 0, 0}) >= kMinWidthM && free_m({0, 0, 1}) >= kMinWidthM;
}

std::vector<glm::vec3> points_of_air(const AcousticSurfaces& surfaces) {
  const Bounds& bounds = surfaces.scene().bounds();
  const Bounds air = box_of_air(surfaces);
  glm::vec3 lower = air.lower, size = air.upper - air.lower;
  const auto place = [&](std::uint32_t cell, std::uint32_t attempt) {
    const std::array<float, 4> u = probe_stream(ProbeUse::place, cell).uniform4(attempt);
    const glm::vec3 relative((static_cast<float>(cell % kCellsX) + u[0]) / kCellsX,
                             (static_cast<float>(cell / kCellsX % kCellsY) + u[1]) / kCellsY,
                             (static_cast<float>(cell / (kCellsX * kCellsY)) + u[2]) / kCellsZ);
    return lower + relative * size;
  };
  std::vector<glm::vec3> points;
  for (std::uint32_t cell = 0; cell < kCells; ++cell) {
    for (std::uint32_t attempt = 0; attempt < kTriesPerCell; ++attempt) {
      const glm::vec3 point = place(cell, attempt);
      if (!is_room(surfaces, point)) continue;
      points.push_back(point);
      break;
    }
  }
  if (!points.empty()) return points;
  // A model, or walls without a floor: all around it.
  const float margin_m = 0.1f * surfaces.diagonal_m();
  lower = bounds.lower - margin_m;
  size = bounds.upper - bounds.lower + 2.f * margin_m;
  for (std::uint32_t cell = 0; cell < kCells; ++cell) points.push_back(place(cell, 0));
  return points;
}

namespace {

/// Loss per metre of the box whose walls the six hits are, on opposite sides by twos.  Absorption by area, which goes with one over the
/// distance of two walls, as the mean free path does: 4 V / S = 2 / sum(1 / width).
void loss_of_box(const AcousticSurfaces& surfaces, const std::array<Hit, 6>& hits, std::span<const double> air_energy_per_m,
                 std::span<double> loss_per_m) {
  const auto& materials = surfaces.scene().mesh().triangle_material;
  double inverse_m = 0;
  std::array<double, 3> inverse{};
  for (std::size_t axis = 0; axis < 3; ++axis) {
    double width_m = 0;
    for (const std::size_t side : {2 * axis, 2 * axis + 1})
      width_m += hits[side].valid() ? double{hits[side].distance_m} : double{surfaces.diagonal_m()};
    inverse_m += inverse[axis] = 1.0 / std::max(width_m, 1e-3);
  }
  for (std::size_t band = 0; band < loss_per_m.size(); ++band) {
    double kept = 0;
    for (std::size_t side = 0; side < 6; ++side)
      if (hits[side].valid()) kept += 0.5 * inverse[side / 2] * surfaces.reflectance(materials[hits[side].triangle])[band];
    loss_per_m[band] = -std::log(std::max(kept / inverse_m, 1e-6)) * 0.5 * inverse_m + air_energy_per_m[band];
  }
}

constexpr std::array<glm::vec3, 6> kAxes{glm::vec3(0, -1, 0), glm::vec3(0, 1, 0),  glm::vec3(-1, 0, 0),
                                         glm::vec3(1, 0, 0),  glm::vec3(0, 0, -1), glm::vec3(0, 0, 1)};

}  // namespace

RoomGuess guess_room(const AcousticSurfaces& surfaces, glm::vec3 point, std::span<const double> air_energy_per_m) {
  RoomGuess room;
  room.closed = true;
  room.volume_m3 = 1;
  std::array<Hit, 6> hits;
  for (std::size_t side = 0; side < 6; ++side) {
    hits[side] = surfaces.scene().rays().intersect(point, kAxes[side]);
    room.closed = room.closed && hits[side].valid();
    if (side % 2 == 1)
      room.volume_m3 *= std::min(double{hits[side - 1].distance_m} + double{hits[side].distance_m}, double{surfaces.diagonal_m()});
  }
  room.loss_per_m.resize(static_cast<std::size_t>(surfaces.num_bands()));
  loss_of_box(surfaces, hits, air_energy_per_m, room.loss_per_m);
  return room;
}

std::vector<glm::vec3> live_points(const AcousticSurfaces& surfaces, std::span<const double> air_energy_per_m, double below_per_m,
                                   std::size_t most) {
  const EmbreeScene& rays = surfaces.scene().rays();
  const Bounds air = box_of_air(surfaces);
  const glm::dvec3 size(air.upper - air.lower);
  const double layers = std::clamp(std::round(size.y / kSurveyLayerM), 1.0, 16.0);
  const double step_m = std::max(kSurveyStepM, std::sqrt(std::max(size.x, 1e-3) * std::max(size.z, 1e-3) * layers / kMaxPlaces));
  const auto steps = [&](double width_m) { return static_cast<std::uint32_t>(std::clamp(std::floor(width_m / step_m), 1.0, kMaxPlaces)); };
  const std::array<std::uint32_t, 3> cells{steps(size.x), static_cast<std::uint32_t>(layers), steps(size.z)};
  struct Place {
    double loss_per_m;
    glm::vec3 point;
  };
  std::vector<Place> places;
  std::vector<double> loss(air_energy_per_m.size());
  std::uint32_t item = 0;
  for (std::uint32_t x = 0; x < cells[0]; ++x) {
    for (std::uint32_t y = 0; y < cells[1]; ++y) {
      for (std::uint32_t z = 0; z < cells[2]; ++z, ++item) {
        const std::array<float, 4> u = probe_stream(ProbeUse::survey, item).uniform4(0);
        const glm::vec3 relative((static_cast<float>(x) + u[0]) / static_cast<float>(cells[0]),
                                 (static_cast<float>(y) + u[1]) / static_cast<float>(cells[1]),
                                 (static_cast<float>(z) + u[2]) / static_cast<float>(cells[2]));
        const glm::vec3 point = air.lower + relative * (air.upper - air.lower);
        std::array<Hit, 6> hits;
        bool room = true;
        for (std::size_t side = 0; side < 6 && room; ++side) {
          hits[side] = rays.intersect(point, kAxes[side]);
          room = hits[side].valid();
          if (room && side % 2 == 1) room = hits[side - 1].distance_m + hits[side].distance_m >= (side == 1 ? kMinHeightM : kMinWidthM);
        }
        if (!room) continue;
        loss_of_box(surfaces, hits, air_energy_per_m, loss);
        const double least = *std::min_element(loss.begin(), loss.end());
        if (least < below_per_m) places.push_back({least, point});
      }
    }
  }
  std::stable_sort(places.begin(), places.end(), [](const Place& a, const Place& b) { return a.loss_per_m < b.loss_per_m; });
  std::vector<glm::vec3> points;
  for (const Place& place : places) {
    if (points.size() >= most) break;
    const bool seen = std::any_of(points.begin(), points.end(), [&](glm::vec3 other) { return !rays.occluded(other, place.point); });
    if (!seen) points.push_back(place.point);
  }
  return points;
}

}  // namespace earshot
