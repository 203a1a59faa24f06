// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <gtest/gtest.h>

#include <cstdint>
#include <string>
#include <vector>

#include "sim/nav/geodesic_field.h"
#include "sim/nav/navmesh.h"
#include "sim/scene/generators/house_generator.h"

namespace earshot {

/// Free floor of a generated house from its boxes alone: points of a 0.1 m grid with 0.15 m of floor and no furniture around.
class FreeFloor {
 public:
  struct Point {
    glm::vec3 position;
    std::uint32_t room;  ///< object index of its floor
  };

  explicit FreeFloor(const TriangleMesh& mesh) {
    collect(mesh);
    const Bounds bounds = bounds_of(mesh);
    for (float x = bounds.lower.x; x < bounds.upper.x; x += kCellM)
      for (float z = bounds.lower.z; z < bounds.upper.z; z += kCellM)
        if (const auto* floor = floor_at(x, z); floor && is_free(x, z)) points_.push_back({{x, 0, z}, floor->room});
  }

  [[nodiscard]] const std::vector<Point>& points() const { return points_; }
  [[nodiscard]] float area_m2() const { return kCellM * kCellM * static_cast<float>(points_.size()); }

 private:
  static constexpr float kCellM = 0.1f, kClearM = 0.15f;
  struct Rect {
    float x0, z0, x1, z1;
    std::uint32_t room;
    [[nodiscard]] bool holds(float x, float z, float margin) const {
      return x >= x0 - margin && x <= x1 + margin && z >= z0 - margin && z <= z1 + margin;
    }
  };

  void collect(const TriangleMesh& mesh) {
    // Two triangles a floor cell, twelve a box; rugs can be walked on.
    for (std::size_t t = 0; t < mesh.triangles.size();) {
      const std::string& name = mesh.object_names[mesh.triangle_object[t]];
      const auto starts = [&](const char* prefix) { return name.rfind(prefix, 0) == 0; };
      const bool shell = starts("wall_") || starts("floor_") || starts("ceiling_") || starts("window_") || starts("doorframe_");
      const std::size_t count = shell ? 2 : 12;
      Rect rect{1e9f, 1e9f, -1e9f, -1e9f, mesh.triangle_object[t]};
      for (std::size_t i = t; i < t + count; ++i)
        for (int c = 0; c < 3; ++c) {
          const glm::vec3 v = mesh.vertices[mesh.triangles[i][c]];
          rect = {std::min(rect.x0, v.x), std::min(rect.z0, v.z), std::max(rect.x1, v.x), std::max(rect.z1, v.z), rect.room};
        }
      if (starts("floor_"))
        floors_.push_back(rect);
      else if (!shell && !starts("rug_"))
        boxes_.push_back(rect);
      t += count;
    }
  }

  [[nodiscard]] const Rect* floor_at(float x, float z) const {
    for (const Rect& floor : floors_)
      if (floor.holds(x, z, 0)) return &floor;
    return nullptr;
  }
  [[nodiscard]] bool is_free(float x, float z) const {
    for (const Rect& box : boxes_)
      if (box.holds(x, z, kClearM)) return false;
    for (const float dx : {-kClearM, 0.f, kClearM})
      for (const float dz : {-kClearM, 0.f, kClearM})
        if (!floor_at(x + dx, z + dz)) return false;
    return true;
  }

  std::vector<Rect> floors_, boxes_;
  std::vector<Point> points_;
};

/// One island covers the free floor, and every room is on it.  detail: more settings of the house that is walked in; the free floor is
/// that of the house without them.
inline void expect_navigable(const std::string& spec, const std::string& detail = "") {
  const TriangleMesh mesh = generate_house(parse_house(spec));
  const Navmesh nav(generate_house(parse_house(spec + detail)), {});
  const FreeFloor floor(mesh);
  ASSERT_GT(floor.area_m2(), 3.f) << spec;
  EXPECT_GT(nav.main_area_m2(), 0.9f * floor.area_m2()) << spec;
  const GeodesicField field(nav, nav.random_point(RandomStream(1, Purpose::test), 0));
  struct Count {
    int free = 0, reached = 0;
  };
  std::vector<Count> rooms(mesh.object_names.size());
  Count all;
  for (const auto& [position, room] : floor.points()) {
    const auto snapped = nav.snap(position, 0.1f);
    const bool reached = snapped && field.distance_m(*snapped).has_value();
    ++rooms[room].free, ++all.free;
    rooms[room].reached += reached, all.reached += reached;
  }
  EXPECT_GE(all.reached, 0.9 * all.free) << spec;
  for (std::size_t room = 0; room < rooms.size(); ++room) {
    if (mesh.object_names[room].rfind("floor_", 0) != 0) continue;
    EXPECT_GT(rooms[room].free, 50) << spec << " " << mesh.object_names[room];  // half a square metre
    EXPECT_GE(rooms[room].reached, 0.8 * rooms[room].free) << spec << " " << mesh.object_names[room];
  }
}

}  // namespace earshot
