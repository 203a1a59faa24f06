// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <string_view>

#include "sim/scene/mesh/triangle_mesh.h"

namespace earshot {

/// A furnished house of several rooms joined by door openings.  Material names are names of the built-in database; object names
/// are "category_index" ("wall_0", "table_3").
struct HouseConfig {
  std::uint64_t seed = 0;
  int rooms = 0;          ///< 0: drawn from the seed (4 to 9); 1 to 16
  float area_m2 = 0;      ///< floor area of all rooms; 0: drawn from the seed (60 to 200); 12 to 400
  float height_m = 2.7f;  ///< [2.2, 4]
  bool furnished = true;
  /// 0: as few triangles as the shapes need.  Otherwise every edge is at most this long, by subdivision, and shelves carry books, sofas and
  /// beds cushions: the triangles of a scan, with the same rooms and furniture as without.  [0.05, 10].
  float detail_m = 0;
};

/// Reads `SEED[,rooms=3][,area_m2=36][,height_m=2.7][,furnished=false][,detail_m=0.12]`, the text after `house:`.  Throws InputError.
HouseConfig parse_house(std::string_view text);

/// Same config, same bytes on any machine: integer random numbers and + - * / only.  Watertight walls, floor and ceiling (grid of
/// cells, faces only between air and solid); furniture boxes stand a centimetre deep in the floor, so nothing is coplanar.  All
/// of this holds with detail_m too: grids of neighbouring faces share their corners, and the faces of a wall stay in its plane.
/// Every room is reachable through openings at least 0.9 m wide and 2.05 m high.
TriangleMesh generate_house(const HouseConfig& config);

}  // namespace earshot
