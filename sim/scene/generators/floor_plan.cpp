// SPDX-License-Identifier: Apache-2.0
#include "sim/scene/generators/floor_plan.h"

#include <algorithm>
#include <string>
#include <utility>

#include "sim/base/errors.h"
#include "sim/scene/generators/house_generator.h"
#include "sim/scene/generators/plan_settings.h"

namespace earshot {
namespace {

constexpr int kCorridorMm = 2400, kPassageMm = 2000;
constexpr int kShortestRoomMm = 3000, kLongestRoomMm = 6500;
constexpr int kPassageEveryMm = 20'000;
constexpr int kFloorDoorMarginMm = 200;
enum FloorStage : std::uint32_t { floor_walls_stage = 32, floor_doors_stage = 33, floor_windows_stage = 34 };

int snapped_down(int value_mm) { return value_mm / kLatticeMm * kLatticeMm; }
int millimetres(float metres) { return snapped_down(static_cast<int>(metres * 1000.f + 0.5f)); }

/// Rooms side by side along z from z0 to z1, walls between them.
void append_row(int x0, int x1, int z0, int z1, HouseDraws& draws, std::vector<PlanRoom>& rooms) {
  constexpr RoomType types[] = {RoomType::bedroom,  RoomType::bedroom, RoomType::office,
                                RoomType::bathroom, RoomType::living,  RoomType::kitchen};
  for (int at = z0; at < z1;) {
    int end = at + draws.between(kShortestRoomMm / kLatticeMm, kLongestRoomMm / kLatticeMm) * kLatticeMm;
    if (z1 - end < kShortestRoomMm + kWallMm) end = z1;
    if (end - at > kLongestRoomMm + kShortestRoomMm) end = snapped_down((at + z1) / 2);
    rooms.push_back({.floor = {x0, at, x1, end}, .type = types[draws.between(0, 5)]});
    at = end == z1 ? z1 : end + kWallMm;
  }
}

/// A doorway of `door_mm` somewhere in the wall that two rooms share; false if that is too short.
bool add_door(const std::vector<PlanRoom>& rooms, int a, int b, int door_mm, HouseDraws& draws, std::vector<PlanDoor>& doors) {
  const PlanRect &first = rooms[static_cast<std::size_t>(a)].floor, &second = rooms[static_cast<std::size_t>(b)].floor;
  const bool across_x = first.x1 + kWallMm == second.x0 || second.x1 + kWallMm == first.x0;
  const bool across_z = first.z1 + kWallMm == second.z0 || second.z1 + kWallMm == first.z0;
  if (across_x == across_z) return false;
  const int from = across_x ? std::max(first.z0, second.z0) : std::max(first.x0, second.x0);
  const int to = across_x ? std::min(first.z1, second.z1) : std::min(first.x1, second.x1);
  const int steps = (to - from - door_mm - 2 * kFloorDoorMarginMm) / kLatticeMm;
  if (to - from < door_mm + 2 * kFloorDoorMarginMm) return false;
  const int at = from + kFloorDoorMarginMm + draws.between(0, steps) * kLatticeMm;
  PlanRect hole = across_x ? PlanRect{std::min(first.x1, second.x1), at, std::max(first.x0, second.x0), at + door_mm}
                           : PlanRect{at, std::min(first.z1, second.z1), at + door_mm, std::max(first.z0, second.z0)};
  doors.push_back({a, b, hole});
  return true;
}

bool is_corridor(const PlanRoom& room) { return room.type == RoomType::corridor; }

}  // namespace

FloorConfig parse_floor(std::string_view text) {
  FloorConfig config;
  read_plan_settings("floor", text, config.seed, [&](std::string_view key, std::string_view value) {
    if (key == "width_m") return config.width_m = parse_plan_number<float>("floor", key, value), true;
    if (key == "length_m") return config.length_m = parse_plan_number<float>("floor", key, value), true;
    return set_building("floor", key, value, config);
  });
  require(config.width_m >= 18.f && config.width_m <= 40.f, "floor.width_m", config.width_m, "must be 18 to 40");
  require(config.length_m >= 20.f && config.length_m <= 120.f, "floor.length_m", config.length_m, "must be 20 to 120");
  require(config.height_m >= 2.2f && config.height_m <= 4.f, "floor.height_m", config.height_m, "must be 2.2 to 4: doors are 2.05 m high");
  require(config.detail_m == 0.f || (config.detail_m >= 0.05f && config.detail_m <= 10.f), "floor.detail_m", config.detail_m,
          "must be 0.05 to 10, or 0 for as few triangles as the shapes need");
  return config;
}

HousePlan make_floor_plan(const FloorConfig& config) {
  HouseDraws walls(config.seed, floor_walls_stage, 0);
  const int width = millimetres(config.width_m), length = millimetres(config.length_m);
  // Across x: rooms, corridor, core, corridor, rooms.
  const int rows = width - 2 * kCorridorMm - 4 * kWallMm;
  const int outer = snapped_down(rows * walls.between(290, 330) / 1000);
  const int corridor_a = outer + kWallMm, core0 = corridor_a + kCorridorMm + kWallMm;
  const int core1 = width - outer - 2 * kWallMm - kCorridorMm, corridor_b = core1 + kWallMm;
  HousePlan plan;
  plan.height_mm = static_cast<int>(config.height_m * 1000.f + 0.5f);
  std::vector<PlanRoom>& rooms = plan.rooms;
  rooms.push_back({.floor = {corridor_a, 0, corridor_a + kCorridorMm, length}, .type = RoomType::corridor});
  rooms.push_back({.floor = {corridor_b, 0, corridor_b + kCorridorMm, length}, .type = RoomType::corridor});
  append_row(0, outer, 0, length, walls, rooms);
  append_row(corridor_b + kCorridorMm + kWallMm, width, 0, length, walls, rooms);
  // The core: rooms two deep, cut by passages from corridor to corridor.
  const int blocks = std::max(1, (length + kPassageEveryMm / 2) / kPassageEveryMm);
  const int middle = snapped_down((core0 + core1) / 2);
  for (int block = 0, at = 0; block < blocks; ++block) {
    const int end = block + 1 == blocks ? length : snapped_down(length * (block + 1) / blocks) - kPassageMm / 2;
    append_row(core0, middle, at, end, walls, rooms);
    append_row(middle + kWallMm, core1, at, end, walls, rooms);
    if (block + 1 == blocks) break;
    rooms.push_back({.floor = {core0, end + kWallMm, core1, end + kWallMm + kPassageMm}, .type = RoomType::corridor});
    at = end + 2 * kWallMm + kPassageMm;
  }
  HouseDraws draws(config.seed, floor_doors_stage, 0);
  const int count = static_cast<int>(rooms.size());
  for (int a = 0; a < count; ++a)
    for (int b = a + 1; b < count; ++b) {
      const bool corridor_to_room = is_corridor(rooms[a]) != is_corridor(rooms[b]),
                 corridors = is_corridor(rooms[a]) && is_corridor(rooms[b]);
      // Rooms of the core may touch a passage and a corridor: the corridors, which come first, have the door.
      const bool has_door = std::any_of(plan.doors.begin(), plan.doors.end(), [&](const PlanDoor& door) { return door.room_b == b; });
      if (corridors)
        add_door(rooms, a, b, kPassageMm - 2 * kFloorDoorMarginMm, draws, plan.doors);
      else if (corridor_to_room ? !has_door : draws.chance(8))
        add_door(rooms, a, b, draws.chance(30) ? 1200 : kDoorWidthMm, draws, plan.doors);
    }
  HouseDraws window_draws(config.seed, floor_windows_stage, 0);
  plan.windows = place_windows(rooms, window_draws);
  return plan;
}

TriangleMesh generate_floor(const FloorConfig& config) {
  return build_plan(make_floor_plan(config), config.seed, config.furnished, config.detail_m);
}

}  // namespace earshot
