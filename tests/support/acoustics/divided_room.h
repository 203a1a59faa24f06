// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cmath>
#include <cstdint>
#include <glm/geometric.hpp>
#include <glm/vec2.hpp>
#include <memory>

#include "sim/base/random.h"
#include "tests/support/acoustics/rooms.h"

namespace earshot::slits {

/// Two rooms with a sheet between them from (x0, 0) to (x1, 4) in plan, in which a doorway of 2.05 m, 1.5 to 2.4 m along it, is nearly
/// shut.
struct DividedRoom {
  static constexpr double kLength = 7.4, kWidth = 4, kHeight = 2.7, kDoor0 = 1.5, kDoor1 = 2.4, kDoorHeight = 2.05;
  enum class Door { over_a_slit, ajar };

  double x0 = 3.7, x1 = 3.7;
  Door door = Door::over_a_slit;
  double gap_m = 0.02;  ///< height of the slit under the leaf; or between the free edge of the leaf, behind the wall, and the wall

  /// Wall number `number` of those that tests draw, and cells for it: straight along the grid or at an angle of up to 17 degrees.
  struct Drawn;
  static Drawn drawn(std::uint32_t number);

  [[nodiscard]] double wall_x(double y) const { return x0 + (x1 - x0) * y / kWidth; }
  /// x and y of the free edge of a leaf that is ajar.
  [[nodiscard]] glm::dvec2 free_edge() const {
    const glm::dvec2 hinge(wall_x(kDoor0), kDoor0), leaf = glm::dvec2(wall_x(kDoor1), kDoor1) - hinge, along = glm::normalize(leaf);
    return hinge + std::sqrt(glm::dot(leaf, leaf) - gap_m * gap_m) * along + gap_m * glm::dvec2(along.y, -along.x);
  }
  /// Metres along x behind the wall and its leaf, negative before them.
  [[nodiscard]] double behind(glm::vec3 place) const {
    const auto y = -static_cast<double>(place.z), z = static_cast<double>(place.y);
    const glm::dvec2 edge = free_edge();
    const bool is_at_leaf = door == Door::ajar && y > kDoor0 && y < edge.y && z < kDoorHeight;
    const double leaf_x = wall_x(kDoor0) + (edge.x - wall_x(kDoor0)) * (y - kDoor0) / (edge.y - kDoor0);
    return static_cast<double>(place.x) - (is_at_leaf ? leaf_x : wall_x(y));
  }
  [[nodiscard]] TriangleMesh mesh() const {
    TriangleMesh mesh;
    rooms::append_box(mesh, {0, 0, 0}, {kLength, kWidth, kHeight}, 0);
    const auto sheet = [&](glm::dvec2 from, glm::dvec2 to, double z0, double z1) {
      rooms::append_quad(
          mesh,
          {rooms::point(from.x, from.y, z0), rooms::point(to.x, to.y, z0), rooms::point(to.x, to.y, z1), rooms::point(from.x, from.y, z1)},
          0);
    };
    const auto wall = [&](double y) { return glm::dvec2(wall_x(y), y); };
    sheet(wall(0), wall(kDoor0), 0, kHeight);
    sheet(wall(kDoor1), wall(kWidth), 0, kHeight);
    sheet(wall(kDoor0), wall(kDoor1), kDoorHeight, kHeight);
    if (door == Door::ajar)
      sheet(wall(kDoor0), free_edge(), 0, kDoorHeight);
    else
      sheet(wall(kDoor0), wall(kDoor1), gap_m, kDoorHeight);
    return mesh;
  }
  [[nodiscard]] std::shared_ptr<const Scene> scene() const { return rooms::scene_of(mesh(), {Material::uniform("wall", 0.2f, 1.f)}); }
};

struct DividedRoom::Drawn {
  DividedRoom room;
  float cell_m;
};

/// The first two are those of a plain room whose wall lies in the middle of a box and on the border of two.
inline DividedRoom::Drawn DividedRoom::drawn(std::uint32_t number) {
  const RandomStream random(11, Purpose::test, number);
  const auto draw = [&](std::uint32_t index) { return static_cast<double>(random.uniform(index)); };
  const double x = 3 + 1.4 * draw(1), turned = number % 2 == 1 ? 0 : 1.2 * (draw(2) - 0.5);
  Drawn drawn{{.x0 = x - turned, .x1 = x + turned},
              number % 4 == 0   ? 0.6f
              : number % 4 == 1 ? 0.5f
                                : static_cast<float>(0.4 + 0.6 * draw(0))};
  if (number < 2) drawn.room = {};
  if (draw(3) < 0.5) drawn.room.door = Door::ajar, drawn.room.gap_m = 0.03;
  return drawn;
}

}  // namespace earshot::slits
