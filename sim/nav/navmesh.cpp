// SPDX-License-Identifier: Apache-2.0
#include "sim/nav/navmesh.h"

#include <algorithm>
#include <cmath>
#include <span>
#include <utility>

#include "sim/base/errors.h"
#include "sim/base/memory_bytes.h"
#include "sim/base/text/config_reader.h"
#include "sim/nav/geodesic_field.h"
#include "sim/nav/navmesh_impl.h"

namespace earshot {
namespace {

constexpr float kVerticalReachM = 1.f;
constexpr float kOnSurfaceM = 1e-3f, kOnSurfaceHeightM = 0.25f;
constexpr int kLookupNodes = 16;  // none is used
constexpr double kCoveredFraction = 0.25;

bool is_finite(glm::vec3 v) { return std::isfinite(v.x) && std::isfinite(v.y) && std::isfinite(v.z); }

float horizontal_distance(glm::vec3 a, glm::vec3 b) { return std::hypot(a.x - b.x, a.z - b.z); }

Surface surface_of(const dtMeshTile& tile) {
  std::vector<glm::dvec3> vertices;
  for (int v = 0; v < tile.header->vertCount; ++v) vertices.emplace_back(tile.verts[3 * v], tile.verts[3 * v + 1], tile.verts[3 * v + 2]);
  std::vector<Surface::Polygon> polygons(static_cast<std::size_t>(tile.header->polyCount));
  for (std::size_t p = 0; p < polygons.size(); ++p) {
    const dtPoly& poly = tile.polys[p];
    polygons[p].num_corners = poly.vertCount;
    for (int i = 0; i < poly.vertCount; ++i) {
      polygons[p].corners[i] = poly.verts[i];
      const bool joined = poly.neis[i] != 0 && (poly.neis[i] & DT_EXT_LINK) == 0;
      polygons[p].neighbours[i] = joined ? poly.neis[i] - 1 : Surface::kWall;
    }
  }
  return {std::move(vertices), std::move(polygons)};
}

}  // namespace

void read(ConfigReader& reader, NavmeshConfig& config) {
  reader.read("agent_radius_m", config.agent_radius_m, Allowed::above(0).up_to(2), "Radius of the agent's cylinder.");
  reader.read("agent_height_m", config.agent_height_m, Allowed::above(0).up_to(10), "Height of the agent's cylinder.");
  reader.read("max_climb_m", config.max_climb_m, Allowed::at_least(0), "Height of a step that the agent climbs; below agent_height_m.");
  reader.read("max_slope_deg", config.max_slope_deg, Allowed::at_least(0).below(90), "Steepest slope that the agent walks on.");
  reader.read("cell_size_m", config.cell_size_m, Allowed::between(0.005, 1), "Width of the voxels that the navmesh is built from.");
  reader.read("cell_height_m", config.cell_height_m, Allowed::between(0.005, 1), "Height of the voxels that the navmesh is built from.");
  reader.read("min_region_area_m2", config.min_region_area_m2, Allowed::at_least(0).below(1e6),
              "Area of walkable surface below which an island is dropped, such as a table top.");
}

void validate(const NavmeshConfig& config) {
  check_values(config, "navmesh");
  require(config.max_climb_m < config.agent_height_m, "navmesh.max_climb_m", config.max_climb_m,
          "must lie between 0 and the agent's height");
}

OwnedNavMeshQuery make_query(const dtNavMesh& mesh, int num_nodes) {
  OwnedNavMeshQuery query(dtAllocNavMeshQuery());
  if (!query || dtStatusFailed(query->init(&mesh, num_nodes))) throw RunError("navmesh", "no memory for a query");
  return query;
}

Navmesh::Impl::Impl(OwnedNavMesh tile_of, const NavmeshConfig& c)
    : config(c),
      navmesh(std::move(tile_of)),
      first_ref(navmesh->getPolyRefBase(&tile())),
      surface(surface_of(tile())),
      lookup(make_query(*navmesh, kLookupNodes)) {
  any_island.setIncludeFlags(kKeptIsland);
  main_only.setIncludeFlags(kMainIsland);
  collect_islands();
}

Navmesh::Impl::Impl(const TriangleMesh& mesh, const NavmeshConfig& c) : Impl(mesh, EmbreeScene(mesh.vertices, mesh.triangles), c) {}

Navmesh::Impl::Impl(const TriangleMesh& mesh, const EmbreeScene& rays, const NavmeshConfig& c) : Impl(build_tile(mesh, rays, c), c) {
  choose_islands(rays);
  collect_islands();
}

// Drops small islands and finds the main one: where agents start.
void Navmesh::Impl::choose_islands(const EmbreeScene& rays) {
  const auto count = static_cast<std::size_t>(surface.num_islands());
  std::vector<double> area_m2(count, 0), covered_m2(count, 0);
  const int num_polygons = static_cast<int>(surface.polygons().size());
  for (int p = 0; p < num_polygons; ++p) {
    const Surface::Polygon& polygon = surface.polygons()[p];
    glm::dvec3 centre{};
    for (int i = 0; i < polygon.num_corners; ++i) centre += surface.vertex(p, i) / static_cast<double>(polygon.num_corners);
    area_m2[polygon.island] += surface.area_m2(p);
    const glm::vec3 head = glm::vec3(centre) + glm::vec3(0, config.agent_height_m, 0);
    if (rays.intersect(head, {0, 1, 0}).valid()) covered_m2[polygon.island] += surface.area_m2(p);
  }
  // A flat roof may be larger than any floor: where a good part of the surface lies under a ceiling, that part counts.
  const auto largest = std::max_element(area_m2.begin(), area_m2.end());
  const auto most_covered = std::max_element(covered_m2.begin(), covered_m2.end());
  const auto main =
      static_cast<int>(*most_covered >= kCoveredFraction * *largest ? most_covered - covered_m2.begin() : largest - area_m2.begin());
  for (int p = 0; p < num_polygons; ++p) {
    const int island = surface.polygons()[p].island;
    const bool kept = island == main || area_m2[island] >= static_cast<double>(config.min_region_area_m2);
    navmesh->setPolyFlags(ref_of(p), static_cast<unsigned short>((kept ? kKeptIsland : 0) | (island == main ? kMainIsland : 0)));
  }
}

// Polygon flags for islands.
void Navmesh::Impl::collect_islands() {
  const std::span<const Surface::Polygon> polygons = surface.polygons();
  const int num_polygons = static_cast<int>(polygons.size());
  const auto has = [&](int p, NavFlag flag) { return (tile().polys[p].flags & flag) != 0; };
  std::vector<double> area_m2(static_cast<std::size_t>(surface.num_islands()), 0);
  std::vector<bool> kept(area_m2.size(), false);
  main_island = 0;
  for (int p = num_polygons; p-- > 0;) {
    if (has(p, kMainIsland)) main_island = polygons[p].island;
    if (has(p, kKeptIsland)) kept[polygons[p].island] = true;
  }
  for (int p = 0; p < num_polygons; ++p) area_m2[polygons[p].island] += surface.area_m2(p);
  num_kept_islands = 0;
  kept_area_m2 = 0;
  for (std::size_t i = 0; i < area_m2.size(); ++i) {
    if (!kept[i]) continue;
    ++num_kept_islands;
    kept_area_m2 += area_m2[i];
  }
  main_area_before.clear();
  main_triangles.clear();
  main_triangle_polygon.clear();
  double sum_m2 = 0;
  for (int p = 0; p < num_polygons; ++p) {
    const Surface::Polygon& polygon = polygons[p];
    for (int i = 1; polygon.island == main_island && i + 1 < polygon.num_corners; ++i) {
      const glm::dvec3 a = surface.vertex(p, 0), b = surface.vertex(p, i), c = surface.vertex(p, i + 1);
      main_area_before.push_back(sum_m2);
      main_triangles.insert(main_triangles.end(), {a, b, c});
      main_triangle_polygon.push_back(p);
      sum_m2 += 0.5 * ((b.x - a.x) * (c.z - a.z) - (b.z - a.z) * (c.x - a.x));
    }
  }
  main_area_before.push_back(sum_m2);
}

std::optional<Located> Navmesh::Impl::nearest(glm::vec3 point, float reach_m, const dtQueryFilter& filter) const {
  const float extents[3] = {reach_m, kVerticalReachM, reach_m};
  dtPolyRef ref = 0;
  glm::vec3 found{};
  if (dtStatusFailed(lookup->findNearestPoly(&point.x, extents, &filter, &ref, &found.x)) || ref == 0) return std::nullopt;
  if (horizontal_distance(point, found) > reach_m) return std::nullopt;
  return Located{polygon_of(ref), found};
}

std::optional<Located> Navmesh::Impl::locate(glm::vec3 point, float reach_m) const {
  if (!is_finite(point)) return std::nullopt;
  const auto found = nearest(point, reach_m, any_island);
  if (!found || surface.polygons()[found->polygon].island == main_island) return found;
  const bool on_surface = horizontal_distance(found->point, point) < kOnSurfaceM && std::abs(found->point.y - point.y) < kOnSurfaceHeightM;
  if (on_surface) return found;
  const auto on_main = nearest(point, reach_m, main_only);
  return on_main ? on_main : found;
}

float Navmesh::Impl::height_at(int polygon, glm::vec3 point) const {
  float height = point.y;
  if (dtStatusSucceed(lookup->getPolyHeight(ref_of(polygon), &point.x, &height))) return height;
  glm::vec3 closest = point;  // rounding put the point a hair outside its polygon
  lookup->closestPointOnPoly(ref_of(polygon), &point.x, &closest.x, nullptr);
  return closest.y;
}

const CornerGraph& Navmesh::Impl::corners() const {
  std::call_once(corners_built_, [this] {
    corners_ = CornerGraph(surface);
    corners_bytes_.store(corners_.bytes(), std::memory_order_relaxed);
  });
  return corners_;
}

Navmesh::Navmesh(const TriangleMesh& mesh, const NavmeshConfig& config) {
  validate(config);
  impl_ = std::make_unique<Impl>(mesh, config);
}
std::size_t Navmesh::Impl::bytes() const {
  return sizeof(Impl) + sizeof(dtNavMesh) + static_cast<std::size_t>(tile().dataSize) + surface.bytes() + bytes_of(main_area_before) +
         bytes_of(main_triangles) + bytes_of(main_triangle_polygon) + corners_bytes_.load(std::memory_order_relaxed);
}

Navmesh::Navmesh(std::unique_ptr<Impl> impl) : impl_(std::move(impl)) {}
Navmesh::~Navmesh() = default;
Navmesh::Navmesh(Navmesh&&) noexcept = default;

std::optional<glm::vec3> Navmesh::snap(glm::vec3 point, float reach_m) const {
  const auto located = impl_->locate(point, reach_m);
  if (!located) return std::nullopt;
  return located->point;
}

glm::vec3 Navmesh::random_point(const RandomStream& random, std::uint32_t draw) const {
  const auto& before = impl_->main_area_before;
  const double wanted_m2 = static_cast<double>(random.uniform(draw)) * before.back();
  const auto above = std::upper_bound(before.begin(), before.end() - 1, wanted_m2);
  const auto triangle = static_cast<std::size_t>(above - before.begin()) - 1;
  const auto u = random.uniform2(draw + 1);
  const double root = std::sqrt(static_cast<double>(u[0])), fraction = static_cast<double>(u[1]);
  const glm::dvec3* corner = &impl_->main_triangles[3 * triangle];
  const glm::dvec3 inside = (1 - root) * corner[0] + root * (1 - fraction) * corner[1] + root * fraction * corner[2];
  glm::vec3 point(inside);
  point.y = impl_->height_at(impl_->main_triangle_polygon[triangle], point);
  return point;
}

std::optional<float> Navmesh::path_length_m(glm::vec3 from, glm::vec3 to) const {
  if (!impl_->locate(to, 1.f)) return std::nullopt;
  return GeodesicField(*this, to).distance_m(from);
}

float Navmesh::area_m2() const { return static_cast<float>(impl_->kept_area_m2); }
float Navmesh::main_area_m2() const { return static_cast<float>(impl_->main_area_before.back()); }
int Navmesh::num_islands() const { return impl_->num_kept_islands; }
const NavmeshConfig& Navmesh::config() const { return impl_->config; }
std::size_t Navmesh::bytes() const { return impl_->bytes(); }

}  // namespace earshot
