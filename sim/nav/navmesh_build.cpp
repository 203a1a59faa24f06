// SPDX-License-Identifier: Apache-2.0
#include <DetourNavMeshBuilder.h>
#include <Recast.h>

#include <algorithm>
#include <cmath>
#include <glm/common.hpp>
#include <glm/geometric.hpp>
#include <limits>
#include <memory>
#include <numbers>
#include <string>
#include <utility>
#include <vector>

#include "sim/base/errors.h"
#include "sim/nav/navmesh_impl.h"

namespace earshot {
namespace {

struct FreeRecast {
  void operator()(rcHeightfield* p) const noexcept { rcFreeHeightField(p); }
  void operator()(rcCompactHeightfield* p) const noexcept { rcFreeCompactHeightfield(p); }
  void operator()(rcContourSet* p) const noexcept { rcFreeContourSet(p); }
  void operator()(rcPolyMesh* p) const noexcept { rcFreePolyMesh(p); }
  void operator()(rcPolyMeshDetail* p) const noexcept { rcFreePolyMeshDetail(p); }
};
template <class T>
using Recast = std::unique_ptr<T, FreeRecast>;

constexpr std::int64_t kMaxCells = 64'000'000;  // 16 bytes each while the heightfield is open
constexpr int kMergeRegionCells = 400;          // Recast's own default: regions below 20 x 20 cells join a neighbour
constexpr float kContourErrorCells = 1.f;       // largest shift of a straightened border; it reduces the agent's radius
constexpr float kDetailSpacingM = 0.3f;

void check(bool ok, const char* stage) {
  if (!ok)
    throw InputError(std::string("navmesh: ") + stage, "failed: the surface is too large or too complex for one tile",
                     "increase nav.cell_size_m, or split the mesh");
}

[[noreturn]] void nothing_walkable() {
  throw InputError("navmesh", "nothing is walkable: no floor has free space for the agent's height and radius",
                   "check the unit and the up axis of the mesh, or lower nav.agent_height_m");
}

// Cells to cover `length_m`; the small number forgives 0.1f / 0.05f being a hair above 2.
int cells_up(float length_m, float cell_m) { return static_cast<int>(std::ceil(length_m / cell_m - 1e-3f)); }
int cells_down(float length_m, float cell_m) { return static_cast<int>(std::floor(length_m / cell_m + 1e-3f)); }

rcConfig recast_config(const Bounds& bounds, const NavmeshConfig& config) {
  rcConfig rc{};
  rc.cs = config.cell_size_m;
  rc.ch = config.cell_height_m;
  rc.walkableSlopeAngle = config.max_slope_deg;
  rc.walkableHeight = std::max(3, cells_up(config.agent_height_m, rc.ch));
  rc.walkableClimb = cells_down(config.max_climb_m, rc.ch);
  rc.walkableRadius = cells_up(config.agent_radius_m, rc.cs);
  rc.maxSimplificationError = kContourErrorCells;
  rc.minRegionArea = static_cast<int>(config.min_region_area_m2 / (rc.cs * rc.cs));
  rc.mergeRegionArea = kMergeRegionCells;
  rc.maxVertsPerPoly = Surface::kMaxCorners;
  rc.detailSampleDist = kDetailSpacingM;
  rc.detailSampleMaxError = rc.ch;
  // Half a cell of shift: plans drawn on multiples of the cell size have walls in the middle of cells, not on the edge between two,
  // where rounding would choose a side.
  const float pad = 2.5f * rc.cs;
  for (int axis = 0; axis < 3; ++axis) {
    rc.bmin[axis] = bounds.lower[axis] - (axis == 1 ? 0.f : pad);
    rc.bmax[axis] = bounds.upper[axis] + (axis == 1 ? 0.f : pad);
  }
  const double columns = static_cast<double>(rc.bmax[0] - rc.bmin[0]) / static_cast<double>(rc.cs);
  const double rows = static_cast<double>(rc.bmax[2] - rc.bmin[2]) / static_cast<double>(rc.cs);
  if (!(columns * rows < static_cast<double>(kMaxCells)))
    throw InputError("navmesh",
                     "the mesh covers " + std::to_string(static_cast<std::int64_t>(columns * rows)) + " cells, more than 64 million",
                     "check the unit of the mesh, or increase nav.cell_size_m");
  rcCalcGridSize(rc.bmin, rc.bmax, rc.cs, &rc.width, &rc.height);
  return rc;
}

// Faces whose normal points up within the slope limit.  both_sides: of either winding.
std::vector<unsigned char> walkable_areas(const TriangleMesh& mesh, float max_slope_deg, bool both_sides) {
  const float min_up = std::cos(max_slope_deg * std::numbers::pi_v<float> / 180.f);
  std::vector<unsigned char> areas(mesh.triangles.size(), RC_NULL_AREA);
  for (std::size_t t = 0; t < areas.size(); ++t) {
    const glm::vec3 a = mesh.vertices[mesh.triangles[t].x], b = mesh.vertices[mesh.triangles[t].y], c = mesh.vertices[mesh.triangles[t].z];
    const glm::vec3 normal = glm::cross(b - a, c - a);
    const float up = both_sides ? std::abs(normal.y) : normal.y;
    if (up > min_up * glm::length(normal)) areas[t] = RC_WALKABLE_AREA;
  }
  return areas;
}

Recast<rcPolyMesh> build_polygons(const TriangleMesh& mesh, const rcConfig& rc, bool both_sides, Recast<rcCompactHeightfield>& compact) {
  rcContext context(false);
  std::vector<int> indices;
  indices.reserve(3 * mesh.triangles.size());
  for (const glm::uvec3 t : mesh.triangles)
    indices.insert(indices.end(), {static_cast<int>(t.x), static_cast<int>(t.y), static_cast<int>(t.z)});
  const std::vector<unsigned char> areas = walkable_areas(mesh, rc.walkableSlopeAngle, both_sides);

  Recast<rcHeightfield> solid(rcAllocHeightfield());
  check(solid && rcCreateHeightfield(&context, *solid, rc.width, rc.height, rc.bmin, rc.bmax, rc.cs, rc.ch), "heightfield");
  check(rcRasterizeTriangles(&context, &mesh.vertices[0].x, static_cast<int>(mesh.vertices.size()), indices.data(), areas.data(),
                             static_cast<int>(areas.size()), *solid, rc.walkableClimb),
        "rasterization");
  rcFilterLowHangingWalkableObstacles(&context, rc.walkableClimb, *solid);
  rcFilterLedgeSpans(&context, rc.walkableHeight, rc.walkableClimb, *solid);
  rcFilterWalkableLowHeightSpans(&context, rc.walkableHeight, *solid);

  compact.reset(rcAllocCompactHeightfield());
  check(compact && rcBuildCompactHeightfield(&context, rc.walkableHeight, rc.walkableClimb, *solid, *compact), "compact heightfield");
  check(rcErodeWalkableArea(&context, rc.walkableRadius, *compact), "erosion");
  check(rcBuildDistanceField(&context, *compact), "distance field");
  check(rcBuildRegions(&context, *compact, 0, rc.minRegionArea, rc.mergeRegionArea), "regions");
  Recast<rcContourSet> contours(rcAllocContourSet());
  // No wall edges are cut up (length 0): every extra border vertex would be a corner of the shortest-path graph.
  check(contours && rcBuildContours(&context, *compact, rc.maxSimplificationError, 0, *contours), "contours");
  Recast<rcPolyMesh> polygons(rcAllocPolyMesh());
  check(polygons && rcBuildPolyMesh(&context, *contours, rc.maxVertsPerPoly, *polygons), "polygons");
  return polygons;
}

OwnedNavMesh make_tile(const rcConfig& rc, const NavmeshConfig& config, const rcPolyMesh& polygons, const rcPolyMeshDetail& detail) {
  dtNavMeshCreateParams params{};
  params.verts = polygons.verts;
  params.vertCount = polygons.nverts;
  params.polys = polygons.polys;
  params.polyFlags = polygons.flags;
  params.polyAreas = polygons.areas;
  params.polyCount = polygons.npolys;
  params.nvp = polygons.nvp;
  params.detailMeshes = detail.meshes;
  params.detailVerts = detail.verts;
  params.detailVertsCount = detail.nverts;
  params.detailTris = detail.tris;
  params.detailTriCount = detail.ntris;
  params.walkableHeight = config.agent_height_m;
  params.walkableRadius = config.agent_radius_m;
  params.walkableClimb = config.max_climb_m;
  for (int axis = 0; axis < 3; ++axis) {
    params.bmin[axis] = polygons.bmin[axis];
    params.bmax[axis] = polygons.bmax[axis];
  }
  params.cs = rc.cs;
  params.ch = rc.ch;
  params.buildBvTree = true;
  unsigned char* data = nullptr;
  int size = 0;
  check(dtCreateNavMeshData(&params, &data, &size), "Detour tile");
  OwnedNavMesh mesh(dtAllocNavMesh());
  if (!mesh || dtStatusFailed(mesh->init(data, size, DT_TILE_FREE_DATA))) {
    dtFree(data);
    check(false, "Detour mesh");
  }
  return mesh;
}

// Voxel heights are up to a cell too high.  Each vertex is put down on the face below it, so that floors come out flat, walks have
// their true length and the camera its true height.
void settle_heights(const dtNavMesh& navmesh, const EmbreeScene& rays, const rcConfig& rc) {
  const dtMeshTile& tile = *navmesh.getTile(0);
  const auto settle = [&](float* vertex) {
    const float above_m = rc.ch, reach_m = above_m + 3.f * rc.ch;
    // Right on an edge of two faces a ray may slip through: then the next place, a millimetre beside, serves.
    for (const auto& [dx, dz] : {std::pair{0.f, 0.f}, {1e-3f, 0.5e-3f}, {-0.7e-3f, -1e-3f}}) {
      const Hit hit = rays.intersect({vertex[0] + dx, vertex[1] + above_m, vertex[2] + dz}, {0, -1, 0}, reach_m);
      if (!hit.valid()) continue;
      vertex[1] = hit.position.y;
      return;
    }
  };
  for (int v = 0; v < tile.header->vertCount; ++v) settle(tile.verts + 3 * v);
  for (int v = 0; v < tile.header->detailVertCount; ++v) settle(tile.detailVerts + 3 * v);
}

}  // namespace

OwnedNavMesh build_tile(const TriangleMesh& mesh, const EmbreeScene& rays, const NavmeshConfig& config) {
  if (mesh.triangles.empty()) nothing_walkable();
  const rcConfig rc = recast_config(bounds_of(mesh), config);
  Recast<rcCompactHeightfield> compact;
  Recast<rcPolyMesh> polygons = build_polygons(mesh, rc, false, compact);
  // Scans and converters turn whole meshes inside out.  The winding of the file counts unless nothing is walkable with it.
  if (polygons->npolys == 0) polygons = build_polygons(mesh, rc, true, compact);
  if (polygons->npolys == 0) nothing_walkable();
  for (int p = 0; p < polygons->npolys; ++p) polygons->flags[p] = kKeptIsland;

  rcContext context(false);
  Recast<rcPolyMeshDetail> detail(rcAllocPolyMeshDetail());
  check(detail && rcBuildPolyMeshDetail(&context, *polygons, *compact, rc.detailSampleDist, rc.detailSampleMaxError, *detail),
        "detail mesh");
  OwnedNavMesh navmesh = make_tile(rc, config, *polygons, *detail);
  settle_heights(*navmesh, rays, rc);
  return navmesh;
}

}  // namespace earshot
