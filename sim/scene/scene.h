// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <filesystem>
#include <map>
#include <memory>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include "sim/rays/embree_scene.h"
#include "sim/scene/materials/materials.h"
#include "sim/scene/mesh/import_report.h"
#include "sim/scene/mesh/triangle_mesh.h"
#include "sim/scene/readers/mesh_import.h"

namespace earshot {

struct RaySurface;

/// State of the air, from which the speed of sound and its absorption follow.
struct Air {
  float temperature_c = 20.f;     ///< [-20, 50]
  float humidity_percent = 50.f;  ///< [0, 100]
  float pressure_kpa = 101.325f;  ///< [50, 120]
  /// 0: 343.2 sqrt(T / 293.15 K) of ISO 9613-1; otherwise this value (the oracles fix 343.0).
  float speed_of_sound_m_per_s = 0.f;
  [[nodiscard]] float speed() const;
};

/// Geometry with an acoustic material per triangle, ready for rays.  Built once, immutable, shared by all agents and threads.
class Scene {
 public:
  /// material_of_slot: one Material per mesh.material_names entry.
  Scene(std::string name, TriangleMesh mesh, std::vector<Material> material_of_slot, Air air, ImportReport report = {});
  /// The same with what merge_flat_patches(mesh) gave, which takes as long as all the rest.
  Scene(std::string name, TriangleMesh mesh, const RaySurface& surface, std::vector<Material> material_of_slot, Air air,
        ImportReport report);

  [[nodiscard]] const std::string& name() const { return name_; }  ///< the SCENE text it was loaded from
  [[nodiscard]] const TriangleMesh& mesh() const { return mesh_; }
  [[nodiscard]] const std::vector<Material>& materials() const { return materials_; }  ///< per mesh material slot
  [[nodiscard]] const Air& air() const { return air_; }
  [[nodiscard]] float speed_of_sound_m_per_s() const { return speed_of_sound_; }
  /// Meets the surface of the mesh, flat patches in fewer triangles (flat_patches.h): a hit names one with the plane, facing, material and
  /// object of what was hit, not always the very triangle.
  [[nodiscard]] const EmbreeScene& rays() const { return rays_; }
  [[nodiscard]] const Bounds& bounds() const { return bounds_; }
  [[nodiscard]] const ImportReport& import_report() const { return report_; }
  [[nodiscard]] std::uint64_t hash() const { return hash_; }  ///< geometry, names, coefficients and air
  [[nodiscard]] float triangle_area_m2(std::uint32_t triangle) const;
  [[nodiscard]] std::size_t bytes() const;  ///< of memory that it holds, counted
  /// Where the file's origin went: all geometry and every position here is relative to this point, which is zero for a scene near the
  /// origin of its file (origin_near).  Positions in files and on the command line are world positions, those of the file: to_local and
  /// to_world convert them.
  [[nodiscard]] glm::dvec3 origin_m() const { return mesh_.origin_m; }
  [[nodiscard]] glm::vec3 to_local(glm::dvec3 world) const { return world - mesh_.origin_m; }
  [[nodiscard]] glm::dvec3 to_world(glm::vec3 local) const { return glm::dvec3(local) + mesh_.origin_m; }

 private:
  /// surface: null to find it here.
  Scene(std::string name, TriangleMesh mesh, const RaySurface* surface, std::vector<Material> material_of_slot, Air air,
        ImportReport report);

  std::string name_;
  TriangleMesh mesh_;
  std::vector<Material> materials_;
  Air air_;
  float speed_of_sound_;
  EmbreeScene rays_;
  Bounds bounds_;
  ImportReport report_;
  std::uint64_t hash_;
};

/// What a command line may set over the scene it names.
struct SceneOverrides {
  std::optional<double> unit_m;                            ///< metres per unit of a mesh file, as unit_m in a scene YAML
  std::optional<float> simplify_m;                         ///< mesh_simplify.h, as simplify_m in a scene YAML
  std::optional<MeshImportOptions::Up> up = std::nullopt;  ///< axis that points up in a mesh file, as up in a scene YAML
  std::optional<double> cell_m = std::nullopt;             ///< edge of the voxels of a point cloud, as cell_m in a scene YAML
};

/// Loads any SCENE of the command line: a mesh file or a point cloud (`FILE[,unit=M][,up=z][,cell=M]`, mesh_spec.h), `shoebox:XxYxZ[@M]`
/// (shoebox.h), `house:SEED[,key=value...]` (house_generator.h), `floor:SEED[,key=value...]` (floor_plan.h), a scene YAML (keys:
/// scene_config.h) or a scene of Habitat (habitat_scene.h).  Materials: material_assignment.h.  Throws InputError, one clear line.
Scene load_scene(const std::string& spec, const SceneOverrides& overrides = {});

}  // namespace earshot
