// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <glm/vec3.hpp>
#include <memory>
#include <optional>
#include <vector>

#include "sim/base/random.h"
#include "sim/scene/mesh/triangle_mesh.h"

namespace earshot {

class ConfigReader;

/// The cylinder that walks and the voxels of the search for walkable surface.
struct NavmeshConfig {
  float agent_radius_m = 0.1f, agent_height_m = 1.5f;
  float max_climb_m = 0.2f, max_slope_deg = 45.f;
  float cell_size_m = 0.05f, cell_height_m = 0.05f;
  float min_region_area_m2 = 0.5f;  ///< smaller islands (table tops) are dropped
};
/// Reads the fields by their names over `config`.  Throws InputError.
void read(ConfigReader& reader, NavmeshConfig& config);
/// Throws InputError naming key, value and what is allowed.
void validate(const NavmeshConfig& config);

/// Walkable surface of a mesh for a cylinder agent (Recast/Detour).  Immutable; queries are safe from any thread.
/// Heights are those of the mesh's faces.  Cost: 13 ms for a house of 36 m2, 0.2 s for 146,000 triangles.
/// Throws InputError if nothing is walkable.
class Navmesh {
 public:
  Navmesh(const TriangleMesh& mesh, const NavmeshConfig& config);
  ~Navmesh();
  Navmesh(Navmesh&&) noexcept;

  /// Nearest point on the walkable surface within `reach_m` horizontally and 1 m vertically.  A point over a table top, beside a table or
  /// under it means the floor: the largest island is preferred, unless the point lies on another one (to 1 mm and 0.25 m in height).
  [[nodiscard]] std::optional<glm::vec3> snap(glm::vec3 point, float reach_m = 0.5f) const;
  /// Uniform by area over the largest connected island; where a quarter of it or more lies under a ceiling, islands count by the area
  /// that does, so that a flat roof is not taken for the floor.  Draws from `random` at `draw`, `draw + 1`.
  [[nodiscard]] glm::vec3 random_point(const RandomStream& random, std::uint32_t draw) const;
  /// Length of the shortest walkable path; nullopt if there is none (another island).
  [[nodiscard]] std::optional<float> path_length_m(glm::vec3 from, glm::vec3 to) const;
  [[nodiscard]] float area_m2() const;       ///< of the whole surface, table tops and insides of wardrobes included
  [[nodiscard]] float main_area_m2() const;  ///< of the island that agents start on
  [[nodiscard]] int num_islands() const;
  [[nodiscard]] const NavmeshConfig& config() const;
  /// Of memory that it holds now; grows with the graph of corners, which the first geodesic field makes.
  [[nodiscard]] std::size_t bytes() const;

  struct Impl;
  explicit Navmesh(std::unique_ptr<Impl> impl);              ///< for navmesh_image only
  [[nodiscard]] const Impl& impl() const { return *impl_; }  ///< for motion and geodesic_field only

 private:
  std::unique_ptr<Impl> impl_;
};

}  // namespace earshot
