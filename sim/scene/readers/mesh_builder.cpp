// SPDX-License-Identifier: Apache-2.0
#include "sim/scene/readers/mesh_builder.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <glm/common.hpp>
#include <glm/geometric.hpp>
#include <limits>

#include "sim/base/coordinates.h"
#include "sim/base/errors.h"

namespace earshot {

std::string one_line(std::string text) {
  for (char& letter : text) {
    if (static_cast<unsigned char>(letter) < 0x20 || letter == 0x7F) letter = ' ';
  }
  if (text.size() > 200) text.replace(200, text.npos, "...");
  while (text.ends_with(' ')) text.pop_back();
  return text;
}

void MeshBuilder::append(const std::string& object, const std::string& material, const glm::dmat4& to_world,
                         std::span<const glm::dvec3> positions, std::span<const std::uint32_t> corners, PositionDigits digits) {
  const std::size_t first = world_.size();
  if (first + positions.size() >= std::numeric_limits<std::uint32_t>::max()) {
    throw InputError(where_, "has more than 4 billion vertices", "simplify it");
  }
  for (std::size_t i = 0; i < positions.size(); ++i) {
    const glm::dvec3 world = to_world * glm::dvec4(positions[i], 1.0);
    if (!is_valid_position(world)) {
      throw InputError(
          where_,
          fmt::format("vertex {} of '{}' is not finite or farther than {:g} m from the origin", i, one_line(object), kMaxCoordinateM),
          "repair the mesh and export it again");
    }
    world_.push_back(world);
  }
  const std::uint32_t material_slot = intern_fast(mesh_.material_names, materials_, material);
  const std::uint32_t object_index = intern_fast(mesh_.object_names, objects_, object);
  double farthest = 0;
  first_of_part_ = mesh_.triangles.size();
  for (std::size_t i = 0; i + 2 < corners.size(); i += 3) {
    for (std::size_t c = i; c < i + 3; ++c) {
      if (corners[c] >= positions.size()) {
        throw InputError(where_,
                         fmt::format("triangle {} of '{}' uses vertex {}, but there are {} vertices", i / 3, one_line(object), corners[c],
                                     positions.size()),
                         "repair the mesh and export it again");
      }
    }
    const auto base = static_cast<std::uint32_t>(first);
    mesh_.triangles.emplace_back(base + corners[i], base + corners[i + 1], base + corners[i + 2]);
    mesh_.triangle_material.push_back(material_slot);
    mesh_.triangle_object.push_back(object_index);
    if (is_point_or_line(mesh_.triangles.back())) continue;
    for (std::size_t c = i; c < i + 3; ++c)
      for (int axis = 0; axis < 3; ++axis) farthest = std::max(farthest, std::fabs(positions[corners[c]][axis]));
  }
  if (digits == PositionDigits::doubles || !(farthest > 0)) return;
  const double scale =
      std::max({glm::length(glm::dvec3(to_world[0])), glm::length(glm::dvec3(to_world[1])), glm::length(glm::dvec3(to_world[2]))});
  position_step_m_ = std::max(position_step_m_, 0x1p-23 * scale * std::exp2(std::floor(std::log2(farthest))));
}

void MeshBuilder::name_last(std::span<const std::uint32_t> numbers, std::span<const SurfaceName> names) {
  EARSHOT_EXPECT(numbers.size() == mesh_.triangles.size() - first_of_part_);
  has_names_ = true;
  struct Slots {
    std::uint32_t material = 0, object = 0;
  };
  std::unordered_map<std::uint32_t, Slots> slots_of_number;
  for (std::size_t i = 0; i < numbers.size(); ++i) {
    const auto [found, is_new] = slots_of_number.try_emplace(numbers[i]);
    if (is_new) {
      const SurfaceName& name = names[numbers[i]];
      found->second = {intern_fast(mesh_.material_names, materials_, name.category),
                       intern_fast(mesh_.object_names, objects_, name.object)};
    }
    mesh_.triangle_material[first_of_part_ + i] = found->second.material;
    mesh_.triangle_object[first_of_part_ + i] = found->second.object;
  }
}

void MeshBuilder::drop_unused_names() {
  const auto drop = [](std::vector<std::uint32_t>& slots, std::vector<std::string>& names) {
    std::vector<std::uint32_t> new_slot(names.size(), 0);
    for (const std::uint32_t slot : slots) new_slot[slot] = 1;
    std::vector<std::string> kept;
    for (std::size_t slot = 0; slot < names.size(); ++slot) {
      const bool is_used = new_slot[slot] != 0;
      new_slot[slot] = static_cast<std::uint32_t>(kept.size());
      if (is_used) kept.push_back(std::move(names[slot]));
    }
    for (std::uint32_t& slot : slots) slot = new_slot[slot];
    names = std::move(kept);
  };
  drop(mesh_.triangle_material, mesh_.material_names);
  drop(mesh_.triangle_object, mesh_.object_names);
}

bool MeshBuilder::is_point_or_line(glm::uvec3 triangle) const {
  const glm::dvec3 a = world_[triangle.x], b = world_[triangle.y], c = world_[triangle.z];
  return a == b || b == c || c == a;
}

void MeshBuilder::finish() {
  constexpr double infinity = std::numeric_limits<double>::infinity();
  glm::dvec3 lower(infinity), upper(-infinity);
  for (const glm::uvec3 triangle : mesh_.triangles) {
    if (is_point_or_line(triangle)) continue;  // dropped by the repair: it must not say where the mesh lies
    for (int corner = 0; corner < 3; ++corner) {
      lower = glm::min(lower, world_[triangle[corner]]);
      upper = glm::max(upper, world_[triangle[corner]]);
    }
  }
  mesh_.origin_m = origin_near(lower, upper);
  mesh_.vertices.reserve(world_.size());
  for (const glm::dvec3 position : world_) mesh_.vertices.emplace_back(position - mesh_.origin_m);
  world_ = {};
  if (has_names_) drop_unused_names();
}

std::uint32_t MeshBuilder::intern_fast(std::vector<std::string>& names, Index& index, const std::string& name) {
  const auto [found, is_new] = index.try_emplace(name, static_cast<std::uint32_t>(names.size()));
  if (is_new) names.push_back(name);
  return found->second;
}

}  // namespace earshot
