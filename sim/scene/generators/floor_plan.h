// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <string_view>

#include "sim/scene/generators/house_plan.h"
#include "sim/scene/mesh/triangle_mesh.h"

namespace earshot {

/// One floor of a hospital, a school or an office: two corridors along it, passages between them, rooms at both sides of each.
struct FloorConfig {
  std::uint64_t seed = 0;
  float width_m = 25.f;   ///< [18, 40]
  float length_m = 57.f;  ///< [20, 120]
  float height_m = 2.7f;  ///< [2.2, 4]
  bool furnished = true;
  float detail_m = 0;  ///< as of a house (house_generator.h)
};

/// Reads `SEED[,width_m=25][,length_m=57][,height_m=2.7][,furnished=false][,detail_m=0.12]`, the text after `floor:`.  Throws InputError.
FloorConfig parse_floor(std::string_view text);

/// Rooms, a door of each to a corridor and some between rooms, windows.
HousePlan make_floor_plan(const FloorConfig& config);

/// Same config, same bytes on any machine; all that generate_house says of its mesh holds.
TriangleMesh generate_floor(const FloorConfig& config);

}  // namespace earshot
