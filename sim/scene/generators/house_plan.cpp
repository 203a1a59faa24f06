// SPDX-License-Identifier: Apache-2.0
#include "sim/scene/generators/house_plan.h"

#include <algorithm>
#include <cstdlib>
#include <numeric>
#include <optional>
#include <string>
#include <utility>

#include "sim/base/errors.h"
#include "sim/scene/generators/plan_settings.h"

namespace earshot {
namespace {

constexpr int kMinSideMm = 1800, kTightSideMm = 1500, kMinCorridorMm = 1200;
constexpr int kDoorMarginMm = 100;     // jamb to the nearest crossing wall
constexpr float kMinRoomAreaM2 = 6.f;  // below that no plan with 0.9 m doors and furniture comes out
constexpr int kAttempts = 400;
enum Stage : std::uint32_t { size_stage = 0, rooms_stage = 1, doors_stage = 2, windows_stage = 3 };

int snapped(int value_mm) { return (value_mm + kLatticeMm / 2) / kLatticeMm * kLatticeMm; }

int integer_sqrt(std::int64_t value) {
  std::int64_t root = value, next = (value + 1) / 2;
  while (next < root) {
    root = next;
    next = (root + value / root) / 2;
  }
  return static_cast<int>(root);
}

std::int64_t floor_area_mm2(const std::vector<PlanRoom>& rooms) {
  std::int64_t sum = 0;
  for (const PlanRoom& room : rooms) sum += room.floor.area_mm2();
  return sum;
}

// Splits a rectangle into `count` rooms of about equal area by walls from side to side.
class RecursiveSplit {
 public:
  RecursiveSplit(HouseDraws& draws, int jitter_permille) : draws_(draws), jitter_(jitter_permille) {}

  void split(const PlanRect& rect, int count, std::vector<PlanRoom>& rooms) {
    if (count == 1) {
      rooms.push_back({.floor = rect});
      return;
    }
    const int first = count % 2 == 0 ? count / 2 : count / 2 + draws_.between(0, 1);
    const bool along_x = is_much_longer(rect.width(), rect.depth())   ? true
                         : is_much_longer(rect.depth(), rect.width()) ? false
                                                                      : draws_.chance(50);
    split_at(rect, first, count, along_x, rooms);
  }

  // One row of rooms, every wall across the row.
  void split_row(const PlanRect& rect, int count, bool along_x, std::vector<PlanRoom>& rooms) {
    PlanRect rest = rect;
    for (int left = count; left > 1; --left) {
      const auto [part, remainder] = cut(rest, along_x, fraction(1, left));
      rooms.push_back({.floor = part});
      rest = remainder;
    }
    rooms.push_back({.floor = rest});
  }

  static std::pair<PlanRect, PlanRect> cut(const PlanRect& rect, bool along_x, int permille) {
    PlanRect first = rect, second = rect;
    const int length = (along_x ? rect.width() : rect.depth()) - kWallMm;
    const int at = snapped(static_cast<int>(static_cast<std::int64_t>(length) * permille / 1000));
    (along_x ? first.x1 : first.z1) = (along_x ? rect.x0 : rect.z0) + at;
    (along_x ? second.x0 : second.z0) = (along_x ? rect.x0 : rect.z0) + at + kWallMm;
    return {first, second};
  }

 private:
  static bool is_much_longer(int side, int other) { return static_cast<std::int64_t>(side) * 4 > static_cast<std::int64_t>(other) * 5; }

  int fraction(int part, int whole) { return part * 1000 / whole + draws_.between(-jitter_, jitter_) / whole; }

  void split_at(const PlanRect& rect, int first, int count, bool along_x, std::vector<PlanRoom>& rooms) {
    const auto [part, remainder] = cut(rect, along_x, fraction(first, count));
    split(part, first, rooms);
    split(remainder, count - first, rooms);
  }

  HouseDraws& draws_;
  int jitter_;
};

// All numbers come from `draws`, so the same draws on a slightly larger rectangle give the same plan, scaled.
std::vector<PlanRoom> partition(const HouseConfig& config, std::uint32_t attempt, std::int64_t outline_mm2) {
  HouseDraws draws(config.seed, rooms_stage, attempt);
  const int aspect_permille = draws.between(1000, 1600);
  const int width = snapped(integer_sqrt(outline_mm2 * aspect_permille / 1000));
  const int depth = static_cast<int>(outline_mm2 / width) / 10 * 10;
  const bool turned = draws.chance(50);
  const PlanRect outline = turned ? PlanRect{0, 0, depth, width} : PlanRect{0, 0, width, depth};
  // Late attempts try for regular plans: small houses with many rooms admit nothing else.
  const int jitter = 450 * static_cast<int>(kAttempts - attempt) / kAttempts;
  RecursiveSplit splitter(draws, jitter);
  std::vector<PlanRoom> rooms;
  const bool has_corridor = config.rooms >= 5 && attempt < kAttempts / 2 && draws.chance(config.rooms >= 7 ? 80 : 50);
  if (!has_corridor) {
    splitter.split(outline, config.rooms, rooms);
    return rooms;
  }
  const int corridor_mm = draws.between(24, 30) * kLatticeMm;
  const int across = turned ? outline.width() : outline.depth();
  const int rows_mm = across - corridor_mm - 2 * kWallMm;
  const int upper_mm = snapped(rows_mm * draws.between(440, 560) / 1000);
  PlanRect upper = outline, corridor = outline, lower = outline;
  (turned ? upper.x1 : upper.z1) = upper_mm;
  (turned ? corridor.x0 : corridor.z0) = upper_mm + kWallMm;
  (turned ? corridor.x1 : corridor.z1) = upper_mm + kWallMm + corridor_mm;
  (turned ? lower.x0 : lower.z0) = upper_mm + 2 * kWallMm + corridor_mm;
  const int in_upper = (config.rooms - 1) / 2 + ((config.rooms - 1) % 2 == 0 ? 0 : draws.between(0, 1));
  rooms.push_back({.floor = corridor, .type = RoomType::corridor});
  splitter.split_row(upper, in_upper, !turned, rooms);
  splitter.split_row(lower, config.rooms - 1 - in_upper, !turned, rooms);
  return rooms;
}

// tight: the second half of the attempts also takes the narrow rooms that many rooms on little area come to.
bool is_habitable(const std::vector<PlanRoom>& rooms, bool tight) {
  const int min_side_mm = tight ? kTightSideMm : kMinSideMm, max_aspect_percent = tight ? 320 : 260;
  const std::int64_t mean_mm2 = floor_area_mm2(rooms) / static_cast<std::int64_t>(rooms.size());
  return std::all_of(rooms.begin(), rooms.end(), [&](const PlanRoom& room) {
    const int shorter = std::min(room.floor.width(), room.floor.depth()), longer = std::max(room.floor.width(), room.floor.depth());
    if (room.type == RoomType::corridor) return shorter >= kMinCorridorMm;
    return shorter >= min_side_mm && longer * 100 <= shorter * max_aspect_percent && room.floor.area_mm2() * 3 >= mean_mm2;
  });
}

// The wall that two rooms share, as the rectangle of a doorway that would fill it whole; nullopt if none is long enough.
std::optional<PlanRect> shared_wall(const PlanRect& a, const PlanRect& b) {
  PlanRect wall;
  if (a.x1 + kWallMm == b.x0 || b.x1 + kWallMm == a.x0) {
    wall = {std::min(a.x1, b.x1), std::max(a.z0, b.z0), std::max(a.x0, b.x0), std::min(a.z1, b.z1)};
    if (wall.depth() < kDoorWidthMm + 2 * kDoorMarginMm) return std::nullopt;
  } else if (a.z1 + kWallMm == b.z0 || b.z1 + kWallMm == a.z0) {
    wall = {std::max(a.x0, b.x0), std::min(a.z1, b.z1), std::min(a.x1, b.x1), std::max(a.z0, b.z0)};
    if (wall.width() < kDoorWidthMm + 2 * kDoorMarginMm) return std::nullopt;
  } else {
    return std::nullopt;
  }
  return wall;
}

PlanRect place_door(const PlanRect& wall, HouseDraws& draws) {
  const bool along_x = wall.depth() == kWallMm;
  const int length = along_x ? wall.width() : wall.depth();
  const bool wide = length >= 2 * kDoorWidthMm && draws.chance(20);
  const int door_mm = wide ? draws.between(24, 32) * kLatticeMm : kDoorWidthMm;
  const int steps = (length - door_mm - 2 * kDoorMarginMm) / kLatticeMm;
  const int from = kDoorMarginMm + draws.between(0, steps) * kLatticeMm;
  PlanRect hole = wall;
  (along_x ? hole.x0 : hole.z0) += from;
  (along_x ? hole.x1 : hole.z1) = (along_x ? hole.x0 : hole.z0) + door_mm;
  return hole;
}

// Kruskal's spanning tree over random weights, corridor doors first; nullopt if the rooms do not hang together.
std::optional<std::vector<PlanDoor>> join_rooms(const std::vector<PlanRoom>& rooms, HouseDraws& draws) {
  struct Candidate {
    int weight, a, b;
    PlanRect wall;
  };
  std::vector<Candidate> candidates;
  const int count = static_cast<int>(rooms.size());
  for (int a = 0; a < count; ++a)
    for (int b = a + 1; b < count; ++b)
      if (const auto wall = shared_wall(rooms[a].floor, rooms[b].floor)) {
        const bool to_corridor = rooms[a].type == RoomType::corridor || rooms[b].type == RoomType::corridor;
        candidates.push_back({draws.between(0, 999) - (to_corridor ? 1000 : 0), a, b, *wall});
      }
  std::stable_sort(candidates.begin(), candidates.end(), [](const auto& l, const auto& r) { return l.weight < r.weight; });
  std::vector<int> group(rooms.size());
  std::iota(group.begin(), group.end(), 0);
  std::vector<PlanDoor> doors;
  int joined = 1;
  for (const Candidate& candidate : candidates) {
    const int group_a = group[candidate.a], group_b = group[candidate.b];
    const bool needed = group_a != group_b;
    if (!needed && !draws.chance(20)) continue;
    if (needed) ++joined;
    std::replace(group.begin(), group.end(), group_b, group_a);
    doors.push_back({candidate.a, candidate.b, place_door(candidate.wall, draws)});
  }
  if (joined != count) return std::nullopt;
  return doors;
}

void name_rooms(std::vector<PlanRoom>& rooms) {
  std::vector<std::size_t> by_area;
  for (std::size_t i = 0; i < rooms.size(); ++i)
    if (rooms[i].type != RoomType::corridor) by_area.push_back(i);
  std::stable_sort(by_area.begin(), by_area.end(),
                   [&](std::size_t l, std::size_t r) { return rooms[l].floor.area_mm2() > rooms[r].floor.area_mm2(); });
  constexpr RoomType types[] = {RoomType::living, RoomType::bedroom, RoomType::kitchen, RoomType::bedroom, RoomType::office};
  for (std::size_t rank = 0; rank < by_area.size(); ++rank) rooms[by_area[rank]].type = types[rank == 0 ? 0 : 1 + (rank - 1) % 4];
  if (by_area.size() >= 4) rooms[by_area.back()].type = RoomType::bathroom;
}

}  // namespace

std::vector<PlanWindow> place_windows(const std::vector<PlanRoom>& rooms, HouseDraws& draws) {
  int x1 = 0, z1 = 0;
  for (const PlanRoom& room : rooms) {
    x1 = std::max(x1, room.floor.x1);
    z1 = std::max(z1, room.floor.z1);
  }
  std::vector<PlanWindow> windows;
  for (int r = 0; r < static_cast<int>(rooms.size()); ++r) {
    const PlanRect& f = rooms[r].floor;
    const PlanRect sides[] = {{0, f.z0, 0, f.z1}, {x1, f.z0, x1, f.z1}, {f.x0, 0, f.x1, 0}, {f.x0, z1, f.x1, z1}};
    const bool outer[] = {f.x0 == 0, f.x1 == x1, f.z0 == 0, f.z1 == z1};
    for (int side = 0; side < 4; ++side) {
      const bool along_x = side >= 2;
      const int steps = ((along_x ? sides[side].width() : sides[side].depth()) - 600) / kLatticeMm;
      if (!outer[side] || steps < 12 || !draws.chance(60)) continue;
      const int width = draws.between(12, std::min(steps, 36));
      const int from = 300 + draws.between(0, steps - width) * kLatticeMm;
      PlanRect line = sides[side];
      (along_x ? line.x0 : line.z0) += from;
      (along_x ? line.x1 : line.z1) = (along_x ? line.x0 : line.z0) + width * kLatticeMm;
      windows.push_back({r, line});
    }
  }
  return windows;
}

HouseConfig resolve_house(HouseConfig config) {
  const bool area_ok = config.area_m2 == 0.f || (config.area_m2 >= 12.f && config.area_m2 <= 400.f);
  require(config.rooms >= 0 && config.rooms <= 16, "house.rooms", config.rooms, "must be 1 to 16, or 0 to draw it from the seed");
  require(area_ok, "house.area_m2", config.area_m2, "must be 12 to 400, or 0 to draw it from the seed");
  require(config.height_m >= 2.2f && config.height_m <= 4.f, "house.height_m", config.height_m, "must be 2.2 to 4: doors are 2.05 m high");
  require(config.detail_m == 0.f || (config.detail_m >= 0.05f && config.detail_m <= 10.f), "house.detail_m", config.detail_m,
          "must be 0.05 to 10, or 0 for as few triangles as the shapes need");
  HouseDraws draws(config.seed, size_stage, 0);
  const int drawn_rooms = draws.between(4, 9);
  if (config.rooms == 0)
    config.rooms = config.area_m2 == 0.f ? drawn_rooms : std::min(drawn_rooms, static_cast<int>(config.area_m2 / kMinRoomAreaM2));
  if (config.area_m2 == 0.f) {
    const int largest = std::clamp(30 * config.rooms, 60, 200);
    config.area_m2 = static_cast<float>(draws.between(2 * std::clamp(10 * config.rooms, 60, largest), 2 * largest)) / 2.f;
  }
  require(config.area_m2 >= kMinRoomAreaM2 * static_cast<float>(config.rooms), "house.area_m2", config.area_m2,
          "must be at least 6 per room: smaller rooms leave no passage beside the furniture");
  return config;
}

HousePlan make_house_plan(const HouseConfig& config) {
  const auto wanted_mm2 = static_cast<std::int64_t>(config.area_m2 * 1e6f);
  for (std::uint32_t attempt = 0; attempt < kAttempts; ++attempt) {
    // Inner walls take floor away: enlarge the outline until the rooms have area_m2.
    std::int64_t outline_mm2 = wanted_mm2;
    std::vector<PlanRoom> rooms;
    for (int round = 0; round < 4; ++round) {
      rooms = partition(config, attempt, outline_mm2);
      const std::int64_t got_mm2 = floor_area_mm2(rooms);
      outline_mm2 += wanted_mm2 - got_mm2;
    }
    const std::int64_t miss_mm2 = std::abs(floor_area_mm2(rooms) - wanted_mm2);
    if (miss_mm2 * 50 > wanted_mm2 || !is_habitable(rooms, attempt >= kAttempts / 2)) continue;
    HouseDraws door_draws(config.seed, doors_stage, attempt);
    const auto doors = join_rooms(rooms, door_draws);
    if (!doors) continue;
    name_rooms(rooms);
    HouseDraws window_draws(config.seed, windows_stage, attempt);
    auto windows = place_windows(rooms, window_draws);
    return {std::move(rooms), *doors, std::move(windows), static_cast<int>(config.height_m * 1000.f + 0.5f)};
  }
  throw InputError("house:" + std::to_string(config.seed), "no floor plan with these rooms and this area",
                   "choose fewer rooms or a larger area_m2");
}

}  // namespace earshot
