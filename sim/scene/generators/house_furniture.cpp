// SPDX-License-Identifier: Apache-2.0
#include "sim/scene/generators/house_furniture.h"

#include <algorithm>
#include <map>
#include <optional>

#include "sim/scene/generators/plan_settings.h"

namespace earshot {
namespace {

constexpr std::uint32_t kFurnitureStage = 16;  // plus the room's index
constexpr int kWallGapMm = 30, kPieceGapMm = 50;
constexpr int kDoorDepthMm = 800;  // free floor behind a doorway
constexpr int kTries = 24;

constexpr const char* wood = "wood_furniture";
constexpr const char* soft = "upholstery";
constexpr const char* steel = "steel_cabinet";
constexpr const char* ceramic = "ceramic_tiles";

// A box of a piece in its own frame: u along the wall, v off the wall, y up.  Boxes of one piece overlap by a centimetre or stand
// apart; no two faces share a plane.  `part` numbers the semantic objects of a piece (a table and its chairs).
struct LocalBox {
  int u0, u1, y0, y1, v0, v1;
  const char* material;
  int part = 0;
  bool detail = false;
  FurnitureShape shape = FurnitureShape::box;
};

struct Piece {
  std::vector<const char*> parts;  // category of each part
  int width = 0, depth = 0;
  std::vector<LocalBox> boxes;
  bool at_wall = true;
  bool blocks = true;  // a rug does not
};

void add_table(Piece& piece, int part, int u, int v, int width, int depth) {
  piece.boxes.push_back({u, u + width, 710, 750, v, v + depth, wood, part});
  for (const int leg_u : {u + 40, u + width - 100})
    for (const int leg_v : {v + 40, v + depth - 100}) piece.boxes.push_back({leg_u, leg_u + 60, -10, 720, leg_v, leg_v + 60, wood, part});
}

// back_at_v1: the front is toward -v.
void add_chair(Piece& piece, int part, int u, int v, bool back_at_v1) {
  const int width = 440, depth = 450, back_v = back_at_v1 ? v + depth - 50 : v + 10;
  piece.boxes.push_back({u, u + width, 430, 470, v, v + depth, soft, part});
  piece.boxes.push_back({u + 10, u + width - 10, 445, 900, back_v, back_v + 40, wood, part});
  for (const int leg_u : {u + 20, u + width - 60})
    for (const int leg_v : {v + 60, v + depth - 100}) piece.boxes.push_back({leg_u, leg_u + 40, -10, 440, leg_v, leg_v + 40, wood, part});
}

Piece box_piece(const char* category, const char* material, int width, int depth, int height) {
  return {{category}, width, depth, {{0, width, -10, height, 0, depth, material}}};
}

void add_cushion(Piece& piece, LocalBox bounds) {
  bounds.detail = true;
  bounds.shape = FurnitureShape::cushion;
  piece.boxes.push_back(bounds);
}

// Books side by side on a board whose upper side is at `board_y`, from the back at v0; none reaches `top_y`.  Sizes are a fixed sequence,
// not draws, so that furniture stands where it does without them.
void add_books(Piece& piece, int board_y, int top_y, int v0) {
  const int gap = 3, sunk = 5;
  int u = 40;
  for (int i = board_y; u < piece.width - 90; ++i) {
    const int thickness = 18 + i * 37 % 29, height = std::min(180 + i * 53 % 97, top_y - board_y - 20), depth = 130 + i * 71 % 61;
    piece.boxes.push_back({u, u + thickness, board_y - sunk, board_y + height, v0, v0 + depth, "bookshelf", 0, true});
    u += thickness + gap;
  }
}

Piece make_sofa(HouseDraws& draws) {
  const int w = draws.between(28, 46) * kLatticeMm, d = draws.between(17, 19) * kLatticeMm;
  Piece piece{{"sofa"},
              w,
              d,
              {{20, w - 20, -10, 420, 20, d - 30, soft},
               {10, w - 10, 100, 850, 0, 180, soft},
               {0, 170, 80, 600, 40, d, soft},
               {w - 170, w, 80, 600, 40, d, soft}}};
  const int seats = (w - 340) / 550, seat = seats > 0 ? (w - 340) / seats : 0;
  for (int i = 0; i < seats; ++i) {
    const int u = 170 + i * seat;
    add_cushion(piece, {u + 10, u + seat - 10, 395, 520, 190, d - 40, soft});
    add_cushion(piece, {u + 40, u + seat - 40, 500, 820, 160, 300, soft});
  }
  return piece;
}

Piece make_bed(HouseDraws& draws) {
  const int w = draws.between(18, 34) * kLatticeMm, d = 2050;
  Piece piece{{"bed"}, w, d, {{0, w, -10, 300, 10, d, wood}, {20, w - 20, 290, 540, 40, d - 20, soft}, {5, w - 5, 60, 950, 0, 60, wood}}};
  const int pillows = w / 800 > 0 ? w / 800 : 1, pillow = w / pillows;
  for (int i = 0; i < pillows; ++i) add_cushion(piece, {i * pillow + 60, (i + 1) * pillow - 60, 525, 690, 80, 520, soft});
  return piece;
}

Piece make_shelf(HouseDraws& draws) {
  const int w = draws.between(14, 24) * kLatticeMm, d = 300, h = draws.between(32, 40) * kLatticeMm;
  Piece piece{{"shelf"}, w, d, {{0, 25, -10, h, 0, d, wood}, {w - 25, w, -10, h, 0, d, wood}, {15, w - 15, 20, h - 20, 10, 30, wood}}};
  const int boards = 5;
  for (int i = 0; i < boards; ++i) {
    const int y = 50 + i * (h - 120) / (boards - 1);
    piece.boxes.push_back({20, w - 20, y, y + 25, 20, d - 10, wood});
    if (i + 1 < boards) add_books(piece, y + 25, 50 + (i + 1) * (h - 120) / (boards - 1), 35);
  }
  return piece;
}

Piece make_dining_set(HouseDraws& draws) {
  const int w = draws.between(24, 36) * kLatticeMm, d = draws.between(15, 18) * kLatticeMm;
  Piece piece{{"table"}, w, d + 840, {}, false};
  add_table(piece, 0, 0, 420, w, d);
  for (const bool far : {false, true})
    for (const int u : {w / 4 - 220, 3 * w / 4 - 220}) {
      piece.parts.push_back("chair");
      // Seats are pushed 30 mm under the table top, short of its legs; backs stay outside.
      add_chair(piece, static_cast<int>(piece.parts.size()) - 1, u, far ? d + 390 : 0, far);
    }
  return piece;
}

Piece make_desk(HouseDraws& draws) {
  const int w = draws.between(22, 32) * kLatticeMm, d = 700, chair_u = draws.between(3, (w - 440) / kLatticeMm - 3) * kLatticeMm + 5;
  Piece piece{{"table", "chair"}, w, d + 400, {}};
  add_table(piece, 0, 0, 0, w, d);
  add_chair(piece, 1, chair_u, d - 50, true);
  return piece;
}

Piece make_tv(HouseDraws& draws) {
  const int w = draws.between(22, 32) * kLatticeMm, d = 400;
  return {{"cabinet", "tv"}, w, d, {{0, w, -10, 500, 0, d, wood, 0}, {60, w - 60, 490, 1120, 120, 180, "tv_glass", 1}}};
}

Piece make_plant(HouseDraws& draws) {
  const int height = draws.between(16, 30) * kLatticeMm;
  return {{"plant"}, 450, 450, {{75, 375, -10, 350, 75, 375, ceramic}, {0, 450, 340, height, 0, 450, "plant_foliage"}}};
}

Piece make_rug(HouseDraws& draws, const PlanRect& floor) {
  const int w = draws.between(24, 24 + std::clamp((floor.width() - 1600) / kLatticeMm, 0, 30)) * kLatticeMm - 13;
  const int d = draws.between(20, 20 + std::clamp((floor.depth() - 1400) / kLatticeMm, 0, 20)) * kLatticeMm - 13;
  return {{"rug"}, w, d, {{0, w, -5, 11, 0, d, "rug_heavy"}}, false, false};
}

Piece make_toilet() { return {{"toilet"}, 380, 680, {{0, 380, 350, 800, 0, 190, ceramic}, {20, 360, -10, 420, 20, 680, ceramic}}}; }

Piece make_bathtub() {
  const int w = 1600, d = 720;  // rims stand around a sunken floor
  return {{"bathtub"},
          w,
          d,
          {{20, w - 20, -10, 150, 20, d - 20, ceramic},
           {0, 80, 10, 550, 5, d - 5, ceramic},
           {w - 80, w, 10, 550, 5, d - 5, ceramic},
           {60, w - 60, 15, 545, 0, 80, ceramic},
           {60, w - 60, 15, 545, d - 80, d, ceramic}}};
}

std::vector<Piece> wanted_pieces(const PlanRoom& room, HouseDraws& draws) {
  const int area_m2 = static_cast<int>(room.floor.area_mm2() / 1000000);
  std::vector<Piece> pieces;
  const auto cabinet = [&] {
    // One draw per statement: the order in which arguments are evaluated is the compiler's choice.
    const int height = draws.between(16, 20) * kLatticeMm, width = draws.between(16, 32) * kLatticeMm;
    return box_piece("cabinet", wood, width, 450, height);
  };
  switch (room.type) {
    case RoomType::living:
      pieces = {make_sofa(draws), make_tv(draws)};
      if (area_m2 >= 12) pieces.push_back(make_dining_set(draws));
      if (area_m2 >= 25) pieces.push_back(make_sofa(draws));
      pieces.push_back(make_shelf(draws));
      pieces.push_back(make_plant(draws));
      if (area_m2 >= 20) pieces.push_back(cabinet());
      if (area_m2 >= 30) pieces.push_back(make_plant(draws));
      if (draws.chance(80)) pieces.push_back(make_rug(draws, room.floor));
      break;
    case RoomType::bedroom:
      pieces = {make_bed(draws), box_piece("cabinet", wood, draws.between(18, 40) * kLatticeMm, 600, 2000)};
      if (area_m2 >= 12) pieces.push_back(make_desk(draws));
      if (area_m2 >= 16) pieces.push_back(make_shelf(draws));
      if (draws.chance(60)) pieces.push_back(make_rug(draws, room.floor));
      break;
    case RoomType::kitchen:
      pieces = {box_piece("counter", steel, draws.between(24, 48) * kLatticeMm, 600, 900),
                box_piece("refrigerator", steel, 600, 650, 1800)};
      if (area_m2 >= 9) pieces.push_back(make_dining_set(draws));
      if (area_m2 >= 14) pieces.push_back(box_piece("counter", steel, draws.between(24, 40) * kLatticeMm, 600, 900));
      pieces.push_back(cabinet());
      break;
    case RoomType::bathroom:
      pieces = {make_bathtub(), make_toilet(), box_piece("sink", ceramic, 600, 450, 850)};
      break;
    case RoomType::office:
      pieces = {make_desk(draws), make_shelf(draws), cabinet(), make_plant(draws)};
      if (area_m2 >= 14) pieces.push_back(make_desk(draws));
      if (draws.chance(50)) pieces.push_back(make_rug(draws, room.floor));
      break;
    case RoomType::corridor:
      if (draws.chance(60)) pieces.push_back(make_plant(draws));
      if (std::min(room.floor.width(), room.floor.depth()) >= 1400) pieces.push_back(box_piece("cabinet", wood, 800, 300, 850));
      break;
  }
  return pieces;
}

// The free floor of one room in cells of 0.1 m, and what an agent can still reach on it.
class FloorGrid {
 public:
  FloorGrid(const PlanRect& floor, std::vector<PlanRect> door_zones) : floor_(floor), door_zones_(std::move(door_zones)) {
    columns_ = floor.width() / kCellMm;
    rows_ = floor.depth() / kCellMm;
    blocked_.assign(static_cast<std::size_t>(columns_) * rows_, 0);
  }

  // Whether the room stays navigable with `piece` in it.  Passages of 0.7 m (seven cells) must join all doors and four fifths of
  // what such a passage could reach at all; and narrow ones (three cells) must not leave pockets.
  bool admits(const PlanRect& piece) {
    const std::vector<char> before = blocked_;
    block(piece);
    const bool navigable = is_joined(3, 80) && is_joined(1, 99);
    if (!navigable) blocked_ = before;
    return navigable;
  }

 private:
  static constexpr int kCellMm = 100;

  void block(const PlanRect& piece) {
    const int x0 = std::max(0, (piece.x0 - floor_.x0) / kCellMm), x1 = std::min(columns_ - 1, (piece.x1 - floor_.x0 - 1) / kCellMm);
    const int z0 = std::max(0, (piece.z0 - floor_.z0) / kCellMm), z1 = std::min(rows_ - 1, (piece.z1 - floor_.z0 - 1) / kCellMm);
    for (int z = z0; z <= z1; ++z)
      for (int x = x0; x <= x1; ++x) blocked_[index(x, z)] = 1;
  }

  [[nodiscard]] std::size_t index(int x, int z) const { return static_cast<std::size_t>(z) * columns_ + x; }

  // Cells whose square of 2 * margin + 1 cells lies free inside the room, by a summed-area table.
  [[nodiscard]] std::vector<char> clear_cells(int margin) const {
    std::vector<int> sums(static_cast<std::size_t>(columns_ + 1) * (rows_ + 1), 0);
    const auto sum = [&](int x, int z) -> int& { return sums[static_cast<std::size_t>(z) * (columns_ + 1) + x]; };
    for (int z = 0; z < rows_; ++z)
      for (int x = 0; x < columns_; ++x) sum(x + 1, z + 1) = sum(x, z + 1) + sum(x + 1, z) - sum(x, z) + blocked_[index(x, z)];
    std::vector<char> clear(blocked_.size(), 0);
    for (int z = margin; z < rows_ - margin; ++z)
      for (int x = margin; x < columns_ - margin; ++x) {
        const int x0 = x - margin, x1 = x + margin + 1, z0 = z - margin, z1 = z + margin + 1;
        clear[index(x, z)] = sum(x1, z1) - sum(x0, z1) - sum(x1, z0) + sum(x0, z0) == 0;
      }
    return clear;
  }

  [[nodiscard]] bool is_joined(int margin, int percent) const {
    std::vector<char> clear = clear_cells(margin);
    const auto total = std::count(clear.begin(), clear.end(), 1);
    std::vector<std::size_t> doors;
    for (const PlanRect& zone : door_zones_) {
      const int x = std::clamp(((zone.x0 + zone.x1) / 2 - floor_.x0) / kCellMm, margin, columns_ - 1 - margin);
      const int z = std::clamp(((zone.z0 + zone.z1) / 2 - floor_.z0) / kCellMm, margin, rows_ - 1 - margin);
      doors.push_back(index(x, z));
    }
    if (doors.empty()) doors.push_back(static_cast<std::size_t>(std::find(clear.begin(), clear.end(), 1) - clear.begin()));
    if (doors[0] >= clear.size() || !clear[doors[0]]) return false;
    std::vector<std::size_t> reached{doors[0]};
    clear[doors[0]] = 2;
    for (std::size_t next = 0; next < reached.size(); ++next) {
      const int x = static_cast<int>(reached[next] % columns_), z = static_cast<int>(reached[next] / columns_);
      const auto visit = [&](int nx, int nz) {
        if (nx < 0 || nz < 0 || nx >= columns_ || nz >= rows_ || clear[index(nx, nz)] != 1) return;
        clear[index(nx, nz)] = 2;
        reached.push_back(index(nx, nz));
      };
      visit(x - 1, z), visit(x + 1, z), visit(x, z - 1), visit(x, z + 1);
    }
    const bool all_doors = std::all_of(doors.begin(), doors.end(), [&](std::size_t door) { return clear[door] == 2; });
    return all_doors && static_cast<std::int64_t>(reached.size()) * 100 >= total * percent;
  }

  PlanRect floor_;
  std::vector<PlanRect> door_zones_;
  int columns_ = 0, rows_ = 0;
  std::vector<char> blocked_;
};

// A piece turned by a multiple of 90 degrees and moved into the room; side: the wall its back faces (z0, z1, x0, x1).
struct Placement {
  int side = 0;
  PlanRect footprint;

  [[nodiscard]] FurnitureBox place(const LocalBox& box, const std::string& object) const {
    const PlanRect& f = footprint;
    FurnitureBox placed{0, 0, box.y0, box.y1, 0, 0, box.material, object, box.shape};
    switch (side) {
      case 0:
        placed.x0 = f.x0 + box.u0, placed.x1 = f.x0 + box.u1, placed.z0 = f.z0 + box.v0, placed.z1 = f.z0 + box.v1;
        break;
      case 1:
        placed.x0 = f.x1 - box.u1, placed.x1 = f.x1 - box.u0, placed.z0 = f.z1 - box.v1, placed.z1 = f.z1 - box.v0;
        break;
      case 2:
        placed.x0 = f.x0 + box.v0, placed.x1 = f.x0 + box.v1, placed.z0 = f.z1 - box.u1, placed.z1 = f.z1 - box.u0;
        break;
      default:
        placed.x0 = f.x1 - box.v1, placed.x1 = f.x1 - box.v0, placed.z0 = f.z0 + box.u0, placed.z1 = f.z0 + box.u1;
        break;
    }
    return placed;
  }
};

std::optional<Placement> draw_placement(const Piece& piece, const PlanRect& floor, HouseDraws& draws) {
  const int side = draws.between(0, 3);
  const bool along_x = side < 2;
  const int width = along_x ? piece.width : piece.depth, depth = along_x ? piece.depth : piece.width;
  const int gap = piece.at_wall ? kWallGapMm : 200;
  const int free_x = floor.width() - width - 2 * gap, free_z = floor.depth() - depth - 2 * gap;
  if (free_x < 0 || free_z < 0) return std::nullopt;
  int x = floor.x0 + gap + draws.between(0, free_x / kLatticeMm) * kLatticeMm;
  int z = floor.z0 + gap + draws.between(0, free_z / kLatticeMm) * kLatticeMm;
  if (piece.at_wall) {
    if (side == 0) z = floor.z0 + gap;
    if (side == 1) z = floor.z1 - gap - depth;
    if (side == 2) x = floor.x0 + gap;
    if (side == 3) x = floor.x1 - gap - width;
  }
  return Placement{side, {x, z, x + width, z + depth}};
}

std::vector<PlanRect> door_zones_of(const HousePlan& plan, int room) {
  std::vector<PlanRect> zones;
  const PlanRect& floor = plan.rooms[room].floor;
  for (const PlanDoor& door : plan.doors) {
    if (door.room_a != room && door.room_b != room) continue;
    PlanRect zone = door.hole;
    if (zone.x1 == floor.x0)
      zone.x0 = floor.x0, zone.x1 = floor.x0 + kDoorDepthMm;
    else if (zone.x0 == floor.x1)
      zone.x1 = floor.x1, zone.x0 = floor.x1 - kDoorDepthMm;
    else if (zone.z1 == floor.z0)
      zone.z0 = floor.z0, zone.z1 = floor.z0 + kDoorDepthMm;
    else
      zone.z1 = floor.z1, zone.z0 = floor.z1 - kDoorDepthMm;
    zones.push_back(zone);
  }
  return zones;
}

}  // namespace

std::vector<FurnitureBox> furnish(const HousePlan& plan, std::uint64_t seed, bool detailed) {
  std::vector<FurnitureBox> boxes;
  std::map<std::string, int> next_index;
  for (int r = 0; r < static_cast<int>(plan.rooms.size()); ++r) {
    const PlanRoom& room = plan.rooms[r];
    HouseDraws draws(seed, kFurnitureStage + static_cast<std::uint32_t>(r), 0);
    const std::vector<PlanRect> door_zones = door_zones_of(plan, r);
    FloorGrid grid(room.floor, door_zones);
    std::vector<PlanRect> taken;
    for (const Piece& piece : wanted_pieces(room, draws)) {
      for (int attempt = 0; attempt < kTries; ++attempt) {
        const auto placement = draw_placement(piece, room.floor, draws);
        if (!placement) continue;
        const PlanRect& footprint = placement->footprint;
        if (piece.blocks) {
          const auto hits = [&](const PlanRect& other) { return footprint.grown(kPieceGapMm).overlaps(other); };
          if (std::any_of(taken.begin(), taken.end(), hits) || std::any_of(door_zones.begin(), door_zones.end(), hits)) continue;
          if (!grid.admits(footprint)) continue;
          taken.push_back(footprint);
        }
        std::vector<std::string> objects;
        for (const char* category : piece.parts) objects.push_back(std::string(category) + "_" + std::to_string(next_index[category]++));
        for (const LocalBox& box : piece.boxes)
          if (detailed || !box.detail) boxes.push_back(placement->place(box, objects[static_cast<std::size_t>(box.part)]));
        break;
      }
    }
  }
  return boxes;
}

}  // namespace earshot
