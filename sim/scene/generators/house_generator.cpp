// SPDX-License-Identifier: Apache-2.0
#include "sim/scene/generators/house_generator.h"

#include <algorithm>
#include <array>
#include <map>
#include <string>
#include <vector>

#include "sim/base/errors.h"
#include "sim/scene/generators/house_detail.h"
#include "sim/scene/generators/house_furniture.h"
#include "sim/scene/generators/house_plan.h"
#include "sim/scene/generators/plan_settings.h"

namespace earshot {
namespace {

const char* floor_material(RoomType type) {
  switch (type) {
    case RoomType::bedroom:
    case RoomType::office:
      return "carpet_on_concrete";
    case RoomType::kitchen:
    case RoomType::bathroom:
      return "ceramic_tiles";
    default:
      return "wood_parquet";
  }
}

// Walls, floors, ceilings and doorways: the air is cut along every coordinate that occurs anywhere in the plan, and faces are
// emitted where an air cell meets a solid one.  Cells share their corners, so there are no cracks and no T-junctions.
class ShellBuilder {
 public:
  // side_mm: longest side of a face; 0: as long as they come.
  ShellBuilder(const HousePlan& plan, int side_mm, TriangleMesh& mesh) : plan_(plan), mesh_(mesh) {
    lines_[1] = {0, kDoorHeightMm, plan.height_mm};
    for (const PlanRoom& room : plan.rooms) add_lines(room.floor);
    for (const PlanDoor& door : plan.doors) add_lines(door.hole);
    for (const PlanWindow& window : plan.windows) add_lines(window.line);
    if (!plan.windows.empty()) lines_[1].insert(lines_[1].end(), {kWindowBottomMm, kWindowTopMm});
    for (auto& lines : lines_) {
      std::sort(lines.begin(), lines.end());
      lines.erase(std::unique(lines.begin(), lines.end()), lines.end());
      lines = subdivided(lines, side_mm);
    }
    fill_cells();
  }

  void emit() {
    for (int i = 0; i < cells(0); ++i)
      for (int k = 0; k < cells(2); ++k)
        for (int j = 0; j < cells(1); ++j) {
          if (air(i, j, k) == kSolid) continue;
          for (int axis = 0; axis < 3; ++axis)
            for (int step : {-1, 1}) emit_face({i, j, k}, axis, step);
        }
  }

 private:
  // Air cells carry the room's index, or the door's index after all rooms.
  static constexpr int kSolid = -1;

  void add_lines(const PlanRect& rect) {
    lines_[0].insert(lines_[0].end(), {rect.x0, rect.x1});
    lines_[2].insert(lines_[2].end(), {rect.z0, rect.z1});
  }

  [[nodiscard]] int cells(int axis) const { return static_cast<int>(lines_[axis].size()) - 1; }

  [[nodiscard]] int air(int i, int j, int k) const {
    if (i < 0 || j < 0 || k < 0 || i >= cells(0) || j >= cells(1) || k >= cells(2)) return kSolid;
    const int owner = owner_[static_cast<std::size_t>(k) * cells(0) + i];
    return is_door(owner) && lines_[1][j] >= kDoorHeightMm ? kSolid : owner;
  }

  [[nodiscard]] bool is_door(int owner) const { return owner >= static_cast<int>(plan_.rooms.size()); }
  [[nodiscard]] const PlanDoor& door(int owner) const { return plan_.doors[owner - static_cast<int>(plan_.rooms.size())]; }

  void fill_cells() {
    owner_.assign(static_cast<std::size_t>(cells(0)) * cells(2), kSolid);
    const auto fill = [&](const PlanRect& rect, int owner) {
      for (int k = 0; k < cells(2); ++k)
        for (int i = 0; i < cells(0); ++i)
          if (lines_[0][i] >= rect.x0 && lines_[0][i] < rect.x1 && lines_[2][k] >= rect.z0 && lines_[2][k] < rect.z1)
            owner_[static_cast<std::size_t>(k) * cells(0) + i] = owner;
    };
    int owner = 0;
    for (const PlanRoom& room : plan_.rooms) fill(room.floor, owner++);
    for (const PlanDoor& doorway : plan_.doors) fill(doorway.hole, owner++);
  }

  std::uint32_t vertex(std::array<int, 3> at) {
    const auto [found, is_new] = vertex_of_.try_emplace(at, static_cast<std::uint32_t>(mesh_.vertices.size()));
    if (is_new) mesh_.vertices.push_back({metres(lines_[0][at[0]]), metres(lines_[1][at[1]]), metres(lines_[2][at[2]])});
    return found->second;
  }

  // The window that holds the face of a cell, -1 if none.
  [[nodiscard]] int window_at(std::array<int, 3> cell, int axis, int line) const {
    if (axis == 1 || lines_[1][cell[1]] < kWindowBottomMm || lines_[1][cell[1]] >= kWindowTopMm) return -1;
    for (int w = 0; w < static_cast<int>(plan_.windows.size()); ++w) {
      const PlanRect& r = plan_.windows[w].line;
      if (axis == 0 && r.x0 == r.x1 && lines_[0][line] == r.x0 && lines_[2][cell[2]] >= r.z0 && lines_[2][cell[2]] < r.z1) return w;
      if (axis == 2 && r.z0 == r.z1 && lines_[2][line] == r.z0 && lines_[0][cell[0]] >= r.x0 && lines_[0][cell[0]] < r.x1) return w;
    }
    return -1;
  }

  void emit_face(std::array<int, 3> cell, int axis, int step) {
    std::array<int, 3> beyond = cell;
    beyond[axis] += step;
    if (air(beyond[0], beyond[1], beyond[2]) != kSolid) return;
    const int line = cell[axis] + (step > 0 ? 1 : 0);
    const int u = (axis + 1) % 3, v = (axis + 2) % 3;
    std::array<std::uint32_t, 4> corner{};  // counter-clockwise about +axis
    for (int c = 0; c < 4; ++c) {
      std::array<int, 3> at = cell;
      at[axis] = line;
      at[u] += c == 1 || c == 2 ? 1 : 0;
      at[v] += c >= 2 ? 1 : 0;
      corner[c] = vertex(at);
    }
    if (step > 0) std::swap(corner[1], corner[3]);  // normals point into the air
    const auto [material, object] = surface(cell, axis, step, line);
    for (const glm::uvec3 triangle : {glm::uvec3{corner[0], corner[1], corner[2]}, glm::uvec3{corner[0], corner[2], corner[3]}}) {
      mesh_.triangles.push_back(triangle);
      mesh_.triangle_material.push_back(intern(mesh_.material_names, material));
      mesh_.triangle_object.push_back(intern(mesh_.object_names, object));
    }
  }

  [[nodiscard]] std::pair<std::string, std::string> surface(std::array<int, 3> cell, int axis, int step, int line) const {
    const int owner = air(cell[0], cell[1], cell[2]);
    const int room = is_door(owner) ? door(owner).room_a : owner;
    const std::string room_index = std::to_string(room);
    if (axis == 1 && step < 0) return {floor_material(plan_.rooms[room].type), "floor_" + room_index};
    if (is_door(owner)) return {"gypsum_board", "doorframe_" + std::to_string(owner - static_cast<int>(plan_.rooms.size()))};
    if (axis == 1) return {"plaster_ceiling", "ceiling_" + room_index};
    if (const int window = window_at(cell, axis, line); window >= 0) return {"window_glass", "window_" + std::to_string(window)};
    return {"gypsum_board", "wall_" + room_index};
  }

  const HousePlan& plan_;
  TriangleMesh& mesh_;
  std::array<std::vector<int>, 3> lines_;  // x, y, z in millimetres
  std::vector<int> owner_;
  std::map<std::array<int, 3>, std::uint32_t> vertex_of_;
};

}  // namespace

HouseConfig parse_house(std::string_view text) {
  HouseConfig config;
  read_plan_settings("house", text, config.seed, [&](std::string_view key, std::string_view value) {
    if (key == "rooms") return config.rooms = parse_plan_number<int>("house", key, value), true;
    if (key == "area_m2") return config.area_m2 = parse_plan_number<float>("house", key, value), true;
    return set_building("house", key, value, config);
  });
  resolve_house(config);
  return config;
}

TriangleMesh build_plan(const HousePlan& plan, std::uint64_t seed, bool furnished, float detail_m) {
  const int side_mm = longest_side_mm(detail_m);
  TriangleMesh mesh;
  ShellBuilder(plan, side_mm, mesh).emit();
  if (!furnished) return mesh;
  for (const FurnitureBox& box : furnish(plan, seed, side_mm > 0)) append_furniture(mesh, box, side_mm);
  return mesh;
}

TriangleMesh generate_house(const HouseConfig& config) {
  const HouseConfig resolved = resolve_house(config);
  return build_plan(make_house_plan(resolved), resolved.seed, resolved.furnished, resolved.detail_m);
}

}  // namespace earshot
