// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <fmt/format.h>

#include <array>
#include <cstdint>
#include <glm/vec3.hpp>
#include <string>
#include <vector>

#include "sim/base/random.h"

namespace earshot {

/// A box-shaped room at a random place, of random size, in a file of random unit and up axis.  World coordinates are metres, y up.
struct DrawnRoom {
  glm::dvec3 lower{0}, size{5, 3, 4};
  double unit_m = 1;
  bool is_z_up = false;

  explicit DrawnRoom(std::uint32_t number) : number_(number) {
    const std::array<double, 4> units{1, 0.01, 0.001, 0.0254};
    size = {3 + 6 * draw(0), 2.3 + 2 * draw(1), 3 + 6 * draw(2)};
    lower = {40 * draw(3) - 20, 8 * draw(4) - 4, 40 * draw(5) - 20};
    unit_m = units[static_cast<std::size_t>(4 * draw(6))];
    is_z_up = draw(7) < 0.5;
  }
  /// Number `index` of this room's own, [0, 1).
  [[nodiscard]] double draw(std::uint32_t index) const {
    return static_cast<double>(RandomStream(2026, Purpose::test, number_).uniform(index));
  }
  /// A place inside, at least a tenth of the size from the walls.
  [[nodiscard]] glm::dvec3 inside(std::uint32_t index) const {
    const glm::dvec3 at(draw(10 + 3 * index), draw(11 + 3 * index), draw(12 + 3 * index));
    return lower + size * (0.1 + 0.8 * at);
  }
  /// A place outside, from 0.1 to 3 times the size beyond one of the walls.
  [[nodiscard]] glm::dvec3 outside(std::uint32_t index) const {
    glm::dvec3 place = inside(index);
    const int axis = static_cast<int>(3 * draw(100 + 3 * index));
    const double beyond = size[axis] * (0.1 + 2.9 * draw(101 + 3 * index));
    place[axis] = draw(102 + 3 * index) < 0.5 ? lower[axis] - beyond : lower[axis] + size[axis] + beyond;
    return place;
  }
  /// From metres, y up, to what stands in the file.
  [[nodiscard]] glm::dvec3 to_file(glm::dvec3 world) const { return (is_z_up ? glm::dvec3(world.x, -world.z, world.y) : world) / unit_m; }
  /// Flags of a command that reads the file as it is meant.
  [[nodiscard]] std::string flags() const { return fmt::format(" --unit {} --up {}", unit_m, is_z_up ? 'z' : 'y'); }

  /// As OBJ: six sides of their own, called by `names` (x0 x1 floor ceiling z0 z1), those named "" left out.
  [[nodiscard]] std::string obj(const std::array<std::string, 6>& names) const {
    std::string text;
    for (int corner = 0; corner < 8; ++corner) {
      const glm::dvec3 p = to_file(lower + size * glm::dvec3(corner & 1, corner >> 1 & 1, corner >> 2 & 1));
      text += fmt::format("v {:.9g} {:.9g} {:.9g}\n", p.x, p.y, p.z);
    }
    constexpr std::array<std::array<int, 4>, 6> sides{{{1, 3, 7, 5}, {2, 6, 8, 4}, {1, 5, 6, 2}, {3, 4, 8, 7}, {1, 2, 4, 3}, {5, 7, 8, 6}}};
    for (std::size_t side = 0; side < sides.size(); ++side) {
      if (names[side].empty()) continue;
      const auto& [a, b, c, d] = sides[side];
      text += fmt::format("o {}\nusemtl {}\nf {} {} {} {}\n", names[side], names[side], a, b, c, d);
    }
    return text;
  }
  /// With surfaces that the database names a material for; walls let some sound through.
  [[nodiscard]] std::string obj() const { return obj({"wall", "wall", "floor", "ceiling", "wall", "wall"}); }

  /// With surfaces of the default material, which lets nothing through.
  [[nodiscard]] std::string opaque_obj() const { return obj({"a", "b", "c", "d", "e", "f"}); }

 private:
  std::uint32_t number_;
};

/// As the command line takes it.
inline std::string point_text(glm::dvec3 p) { return fmt::format("{:.6f},{:.6f},{:.6f}", p.x, p.y, p.z); }

}  // namespace earshot
