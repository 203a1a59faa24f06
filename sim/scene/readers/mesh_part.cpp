// SPDX-License-Identifier: Apache-2.0
#include "sim/scene/readers/mesh_part.h"

#include <fmt/format.h>

#include "sim/base/errors.h"
#include "sim/scene/mesh/polygon.h"
#include "sim/scene/readers/mesh_builder.h"

namespace earshot {

void FaceCutter::add(std::span<const std::uint32_t> face, MeshPart& part) {
  const std::uint64_t number = num_faces_++;
  if (face.size() > largest_polygon)
    throw InputError(where_, fmt::format("face {} has {} corners", number, face.size()), "triangulate it and export it again");
  for (const std::uint32_t index : face) {
    if (index >= part.positions.size())
      throw InputError(where_,
                       fmt::format("face {} of '{}' uses vertex {}, but there are {} vertices", number, one_line(part.object), index,
                                   part.positions.size()),
                       "repair the mesh and export it again");
  }
  if (face.size() < 3) {
    ++num_without_surface_;
    return;
  }
  if (face.size() == 3) {
    part.corners.insert(part.corners.end(), face.begin(), face.end());
    return;
  }
  polygon_.clear();
  cut_.clear();
  // Relative to the first corner: far from the origin the floats keep their digits.
  for (const std::uint32_t index : face) polygon_.emplace_back(part.positions[index] - part.positions[face[0]]);
  triangulate_polygon(polygon_, cut_);
  for (const std::uint32_t corner : cut_) part.corners.push_back(face[corner]);
}

std::string FaceCutter::warning() const {
  if (num_without_surface_ == 0) return {};
  return fmt::format("{} of {} faces have fewer than three corners and are ignored", num_without_surface_, num_faces_);
}

}  // namespace earshot
