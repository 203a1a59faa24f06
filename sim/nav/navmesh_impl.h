// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <DetourNavMesh.h>
#include <DetourNavMeshQuery.h>

#include <atomic>
#include <cstddef>
#include <glm/vec3.hpp>
#include <memory>
#include <mutex>
#include <optional>
#include <utility>
#include <vector>

#include "sim/nav/corner_graph.h"
#include "sim/nav/navmesh.h"
#include "sim/nav/surface.h"
#include "sim/rays/embree_scene.h"

namespace earshot {

struct FreeNavMesh {
  void operator()(dtNavMesh* mesh) const noexcept { dtFreeNavMesh(mesh); }
};
struct FreeNavMeshQuery {
  void operator()(dtNavMeshQuery* query) const noexcept { dtFreeNavMeshQuery(query); }
};
using OwnedNavMesh = std::unique_ptr<dtNavMesh, FreeNavMesh>;
using OwnedNavMeshQuery = std::unique_ptr<dtNavMeshQuery, FreeNavMeshQuery>;

/// Polygon flags: queries name the flags that they accept.
enum NavFlag : unsigned short { kKeptIsland = 1, kMainIsland = 2 };

/// A search writes to its query's node pool, so queries that search are never shared.
OwnedNavMeshQuery make_query(const dtNavMesh& mesh, int num_nodes);

/// The Recast pipeline, mesh to one Detour tile; every polygon has flag kKeptIsland.  rays: of `mesh`.  Throws InputError if nothing is
/// walkable.
OwnedNavMesh build_tile(const TriangleMesh& mesh, const EmbreeScene& rays, const NavmeshConfig& config);

/// How far off the surface the point of a caller may be.
inline constexpr float kReachM = 0.5f;

/// A point of the surface and the polygon under it.
struct Located {
  int polygon;
  glm::vec3 point;
};

struct Navmesh::Impl {
  Impl(const TriangleMesh& mesh, const NavmeshConfig& config);
  /// From a tile whose polygons have their flags.
  Impl(OwnedNavMesh tile, const NavmeshConfig& config);

  /// The surface point that a query at `point` means: the point below or above if it lies on the surface (to 1 mm and 0.25 m in
  /// height), else the nearest of the main island within reach, else the nearest at all.
  [[nodiscard]] std::optional<Located> locate(glm::vec3 point, float reach_m) const;
  /// Height of the surface over a point of `polygon`, its border included.
  [[nodiscard]] float height_at(int polygon, glm::vec3 point) const;
  [[nodiscard]] dtPolyRef ref_of(int polygon) const { return first_ref | static_cast<dtPolyRef>(polygon); }
  [[nodiscard]] int polygon_of(dtPolyRef ref) const { return static_cast<int>(ref - first_ref); }
  /// Corners of the surface and which of them are in line of sight; built by the first caller.
  [[nodiscard]] const CornerGraph& corners() const;
  [[nodiscard]] const dtMeshTile& tile() const { return *std::as_const(*navmesh).getTile(0); }
  [[nodiscard]] std::size_t bytes() const;

  NavmeshConfig config;
  OwnedNavMesh navmesh;
  dtPolyRef first_ref = 0;
  Surface surface;
  int main_island = 0;
  int num_kept_islands = 0;
  double kept_area_m2 = 0;
  std::vector<double> main_area_before;  ///< per triangle of the main island: area of all before it; one more at the end
  std::vector<glm::dvec3> main_triangles;
  std::vector<int> main_triangle_polygon;
  /// Shared by all threads: looking up the nearest polygon, closest points and heights touches no node pool of a query.
  OwnedNavMeshQuery lookup;
  dtQueryFilter any_island, main_only;

 private:
  [[nodiscard]] std::optional<Located> nearest(glm::vec3 point, float reach_m, const dtQueryFilter& filter) const;
  Impl(const TriangleMesh& mesh, const EmbreeScene& rays, const NavmeshConfig& config);
  void choose_islands(const EmbreeScene& rays);
  void collect_islands();

  mutable std::once_flag corners_built_;
  mutable std::atomic<std::size_t> corners_bytes_{0};
  mutable CornerGraph corners_;
};

/// As in corridor.h.
std::optional<double> corridor_length_m(const Navmesh::Impl& nav, const Located& from, const Located& to);

}  // namespace earshot
