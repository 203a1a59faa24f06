// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <array>
#include <cmath>
#include <glm/geometric.hpp>
#include <glm/vec3.hpp>
#include <memory>
#include <numbers>
#include <vector>

#include "tests/support/acoustics/rooms.h"

namespace earshot::tilted {

/// Two square mirrors of 8 m, in oracle axes: one at x = 0, the other about x = 6 m and turned by `tilt_deg` about its middle line along y.
/// On demand a floor at z = -4 m between them, and a black screen at x = 3 m from z = screen_m up.
struct Mirrors {
  static constexpr double kGapM = 6, kHalfM = 4;
  struct Plane {
    glm::dvec3 point, normal, up, side;  // up, side: half edges
  };
  std::vector<Plane> planes;
  double absorption;
  double screen_m = kHalfM;  ///< kHalfM: none

  explicit Mirrors(double tilt_deg, double absorbed = 0.02, bool with_floor = false) : absorption(absorbed) {
    const double a = tilt_deg * std::numbers::pi / 180;
    planes.push_back({{0, 0, 0}, {1, 0, 0}, {0, 0, kHalfM}, {0, kHalfM, 0}});
    planes.push_back({{kGapM, 0, 0}, {-std::cos(a), 0, std::sin(a)}, kHalfM * glm::dvec3(std::sin(a), 0, std::cos(a)), {0, kHalfM, 0}});
    if (with_floor) planes.push_back({{kGapM / 2, 0, -kHalfM}, {0, 0, 1}, {kGapM / 2 - 0.5, 0, 0}, {0, kHalfM, 0}});
  }

  [[nodiscard]] std::shared_ptr<const Scene> scene() const {
    TriangleMesh mesh;
    const auto append = [&](glm::dvec3 middle, glm::dvec3 up, glm::dvec3 side, std::uint32_t material) {
      const auto at = [&](double u, double s) {
        const glm::dvec3 p = middle + u * up + s * side;
        return rooms::point(p.x, p.y, p.z);
      };
      rooms::append_quad(mesh, {at(-1, -1), at(-1, 1), at(1, 1), at(1, -1)}, material);
    };
    for (const Plane& plane : planes) append(plane.point, plane.up, plane.side, 0);
    if (screen_m < kHalfM) append({kGapM / 2, 0, (kHalfM + screen_m) / 2}, {0, 0, (kHalfM - screen_m) / 2}, {0, kHalfM, 0}, 1);
    return rooms::scene_of(std::move(mesh),
                           {Material::uniform("mirror", static_cast<float>(absorption), 0.f), Material::uniform("black", 1.f, 0.f)});
  }

  /// Path length over the planes of `sequence`, source first; 0 if a reflection misses its mirror or the screen is in the way.
  [[nodiscard]] double path_m(glm::dvec3 source, glm::dvec3 listener, const std::vector<int>& sequence) const {
    std::vector<glm::dvec3> images{source};
    for (const int m : sequence) {
      const Plane& plane = planes[static_cast<std::size_t>(m)];
      images.push_back(images.back() - 2 * glm::dot(images.back() - plane.point, plane.normal) * plane.normal);
    }
    const auto passes = [&](glm::dvec3 from, glm::dvec3 to) {
      const double across = (kGapM / 2 - from.x) / (to.x - from.x);
      return !(across > 0 && across < 1) || from.z + across * (to.z - from.z) < screen_m || screen_m == kHalfM;
    };
    glm::dvec3 at = listener;
    for (std::size_t i = sequence.size(); i > 0; --i) {
      const Plane& plane = planes[static_cast<std::size_t>(sequence[i - 1])];
      const glm::dvec3 toward = images[i] - at;
      const double height = glm::dot(at - plane.point, plane.normal), t = -height / glm::dot(toward, plane.normal);
      if (!(height > 1e-9 && t > 0 && t < 1)) return 0;
      const glm::dvec3 met = at + t * toward, off = met - plane.point;
      if (std::abs(glm::dot(off, plane.up)) > glm::dot(plane.up, plane.up)) return 0;
      if (std::abs(glm::dot(off, plane.side)) > glm::dot(plane.side, plane.side) || !passes(at, met)) return 0;
      at = met;
    }
    return passes(at, source) ? glm::length(images.back() - listener) : 0;
  }

  /// Calls `visit(path_m, order)` for each path of `least` to `most` reflections.  Every sequence is tried.
  template <typename Visit>
  void for_each_path(glm::dvec3 source, glm::dvec3 listener, int least, int most, const Visit& visit) const {
    std::vector<std::vector<int>> sequences{{}};
    for (int order = 0; order <= most; ++order) {
      std::vector<std::vector<int>> longer;
      for (std::vector<int>& sequence : sequences) {
        if (order >= least)
          if (const double length_m = path_m(source, listener, sequence); length_m > 0) visit(length_m, order);
        for (int m = 0; m < static_cast<int>(planes.size()); ++m) {
          if (!sequence.empty() && sequence.back() == m) continue;
          longer.push_back(sequence);
          longer.back().push_back(m);
        }
      }
      sequences = std::move(longer);
    }
  }
};

}  // namespace earshot::tilted
