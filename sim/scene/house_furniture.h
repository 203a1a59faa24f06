#pragma once

#include <string>
#include <vector>

#include "sim/scene/house_plan.h"

namespace earshot {

/// One box of a piece of furniture, whole millimetres.
struct FurnitureBox {
  int x0, x1, y0, y1, z0, z1;
  std::string material;
  std::string object;  ///< "category_index"
};

/// Furnishes every room of the plan.  Footprints keep 20 mm and more from walls and from each other, doorways and 0.8 m behind
/// them stay free, passages at least 0.6 m wide join the doors of a room, and no piece cuts off a part of the floor.
std::vector<FurnitureBox> furnish(const HousePlan& plan, std::uint64_t seed);

}  // namespace earshot
