// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cmath>
#include <memory>
#include <utility>
#include <vector>

#include "sim/base/random.h"
#include "tests/support/acoustics/rooms.h"

/// Rooms in which a field is known worse at some places than in the mean: far down a corridor, behind a door, in a room that a small hole
/// joins to that of the source.
namespace earshot::field_rooms {

using rooms::point;

/// Two rooms in a row along x, with a hole in the wall between them.
struct Pair {
  double first_m = 0, second_m = 0, width_m = 0, height_m = 0;
  double hole_from_m = 0, hole_width_m = 0, hole_height_m = 0;
  float first_absorption = 0, second_absorption = 0;

  [[nodiscard]] std::shared_ptr<const Scene> scene() const {
    TriangleMesh mesh;
    const double end_m = first_m + second_m, to_m = hole_from_m + hole_width_m;
    // Across x, y and z (up) of the oracles.
    const auto sheet = [&](int normal, double at, double u0, double u1, double v0, double v1, std::uint32_t material) {
      const auto corner = [&](double u, double v) {
        return normal == 0 ? point(at, u, v) : normal == 1 ? point(u, at, v) : point(u, v, at);
      };
      rooms::append_quad(mesh, {corner(u0, v0), corner(u1, v0), corner(u1, v1), corner(u0, v1)}, material);
    };
    sheet(0, 0, 0, width_m, 0, height_m, 0);
    sheet(0, end_m, 0, width_m, 0, height_m, 1);
    for (const auto& [from, to, material] : {std::tuple{0.0, first_m, 0u}, std::tuple{first_m, end_m, 1u}}) {
      for (const double side : {0.0, width_m}) sheet(1, side, from, to, 0, height_m, material);
      for (const double level : {0.0, height_m}) sheet(2, level, from, to, 0, width_m, material);
    }
    sheet(0, first_m, 0, hole_from_m, 0, height_m, 0);
    sheet(0, first_m, to_m, width_m, 0, height_m, 0);
    sheet(0, first_m, hole_from_m, to_m, hole_height_m, height_m, 0);
    return rooms::scene_of(std::move(mesh),
                           {Material::uniform("first", first_absorption, 1.f), Material::uniform("second", second_absorption, 1.f)});
  }
  /// In the first room.
  [[nodiscard]] glm::vec3 source() const { return point(0.35 * first_m, 0.4 * width_m, 1.4); }
  /// In front of the middle of the hole, so far from it.
  [[nodiscard]] glm::vec3 beside(double from_wall_m) const { return point(first_m + from_wall_m, hole_from_m + 0.5 * hole_width_m, 1.5); }

  /// A door from a dead to a live room: alone they would decay in some 0.2 and 1 s.
  static Pair door(std::uint32_t number) {
    const RandomStream random(619, Purpose::test, number);
    const auto within = [&](std::uint32_t draw, double low, double high) {
      return low + (high - low) * static_cast<double>(random.uniform(draw));
    };
    Pair pair{.first_m = within(0, 3.5, 6),
              .second_m = within(1, 4, 7),
              .width_m = within(2, 3, 5),
              .height_m = within(3, 2.4, 3.2),
              .hole_width_m = within(4, 0.8, 1.2),
              .hole_height_m = 2.1,
              .first_absorption = static_cast<float>(within(5, 0.3, 0.5)),
              .second_absorption = static_cast<float>(within(6, 0.05, 0.1))};
    pair.hole_from_m = within(7, 0.4, pair.width_m - pair.hole_width_m - 0.4);
    return pair;
  }
};

/// A scene with a source and a listener.
struct Setting {
  std::shared_ptr<const Scene> scene;
  glm::vec3 source, listener;

  /// By turns a corridor with the listener far down, the room behind a door, and a box.
  static Setting drawn(std::uint32_t number) {
    const RandomStream random(620, Purpose::test, number);
    const auto within = [&](std::uint32_t draw, double low, double high) {
      return low + (high - low) * static_cast<double>(random.uniform(draw));
    };
    if (number % 3 == 1) {
      const Pair pair = Pair::door(100 + number);
      return {pair.scene(), pair.source(), point(pair.first_m + 0.6 * pair.second_m, 0.5 * pair.width_m, 1.5)};
    }
    const bool is_corridor = number % 3 == 0;
    const double x_m = is_corridor ? within(0, 14, 24) : within(0, 4, 8), y_m = is_corridor ? within(1, 1.2, 2.2) : within(1, 3, 6),
                 z_m = within(2, 2.2, 3.2);
    return {rooms::box(x_m, y_m, z_m, rooms::uniform_walls(within(3, 0.15, 0.3), 1)), point(0.12 * x_m, 0.4 * y_m, 1.4),
            point(within(4, 0.7, 0.9) * x_m, 0.6 * y_m, 1.5)};
  }
};

}  // namespace earshot::field_rooms
