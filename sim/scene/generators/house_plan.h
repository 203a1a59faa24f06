// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <vector>

#include "sim/base/random.h"
#include "sim/scene/generators/house_generator.h"
#include "sim/scene/mesh/triangle_mesh.h"

namespace earshot {

/// Floor plan of a generated house in whole millimetres, so that every machine computes the same bits.
/// The air of the house is the union of the rooms (full height) and the doorways (up to kDoorHeightMm).
struct PlanRect {
  int x0 = 0, z0 = 0, x1 = 0, z1 = 0;
  [[nodiscard]] int width() const { return x1 - x0; }
  [[nodiscard]] int depth() const { return z1 - z0; }
  [[nodiscard]] std::int64_t area_mm2() const { return static_cast<std::int64_t>(width()) * depth(); }
  [[nodiscard]] bool overlaps(const PlanRect& other) const { return x0 < other.x1 && other.x0 < x1 && z0 < other.z1 && other.z0 < z1; }
  [[nodiscard]] PlanRect grown(int margin) const { return {x0 - margin, z0 - margin, x1 + margin, z1 + margin}; }
};

enum class RoomType { corridor, living, bedroom, kitchen, bathroom, office };

struct PlanRoom {
  PlanRect floor;
  RoomType type = RoomType::living;
};

struct PlanDoor {
  int room_a = 0, room_b = 0;
  PlanRect hole;  ///< as deep as the wall is thick
};

struct PlanWindow {
  int room = 0;
  PlanRect line;  ///< on the inner face of an outer wall: no extent across it
};

struct HousePlan {
  std::vector<PlanRoom> rooms;
  std::vector<PlanDoor> doors;
  std::vector<PlanWindow> windows;
  int height_mm = 0;
};

inline constexpr int kWallMm = 120, kDoorWidthMm = 900, kDoorHeightMm = 2050;
inline constexpr int kWindowBottomMm = 900, kWindowTopMm = 2000;

/// Integer random numbers in the order of the calls, from one counter-based stream.
class HouseDraws {
 public:
  HouseDraws(std::uint64_t seed, std::uint32_t stage, std::uint32_t attempt) : stream_(seed, Purpose::house, stage, attempt) {}
  /// Uniform in [lowest, highest].
  int between(int lowest, int highest) {
    return lowest + static_cast<int>(stream_.below(static_cast<std::uint32_t>(highest - lowest + 1), next_++));
  }
  bool chance(int percent) { return between(1, 100) <= percent; }

 private:
  RandomStream stream_;
  std::uint32_t next_ = 0;
};

/// Fills in `rooms` and `area_m2` where they are 0.  Throws InputError for values out of range.
HouseConfig resolve_house(HouseConfig config);

/// Rooms, doors along a spanning tree plus some more, windows.  `config` comes from resolve_house.
HousePlan make_house_plan(const HouseConfig& config);

/// Windows in walls that belong to the outline of the rooms, drawn in the order of the rooms.
std::vector<PlanWindow> place_windows(const std::vector<PlanRoom>& rooms, HouseDraws& draws);

/// Mesh of a plan: its shell, and furniture (house_generator.h says what holds of both).  detail_m: of a house.
TriangleMesh build_plan(const HousePlan& plan, std::uint64_t seed, bool furnished, float detail_m);

}  // namespace earshot
