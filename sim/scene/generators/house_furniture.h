// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <string>
#include <vector>

#include "sim/scene/generators/house_plan.h"

namespace earshot {

/// box: itself.  cushion: the ellipsoid inside the box.
enum class FurnitureShape { box, cushion };

/// One box of a piece of furniture, whole millimetres.
struct FurnitureBox {
  int x0, x1, y0, y1, z0, z1;
  std::string material;
  std::string object;  ///< "category_index"
  FurnitureShape shape = FurnitureShape::box;
};

/// Furnishes every room of the plan.  Footprints keep 20 mm and more from walls and from each other, doorways and 0.8 m behind
/// them stay free, passages at least 0.6 m wide join the doors of a room, and no piece cuts off a part of the floor.
/// detailed: books and cushions too, on the same furniture.
std::vector<FurnitureBox> furnish(const HousePlan& plan, std::uint64_t seed, bool detailed = false);

}  // namespace earshot
