#include "sim/nav/motion.h"

#include <cmath>

#include "sim/base/errors.h"
#include "sim/nav/navmesh_impl.h"

namespace earshot {
namespace {

constexpr float kReachM = 0.5f;         // how far off the surface a caller's point may be
constexpr float kOnSurfaceM = 1e-4f;    // nearer than this it is on the surface, and its bits are kept
constexpr float kStuckM = 1e-4f;        // shorter moves along a wall are rounding: the agent stands still, bit for bit
constexpr float kCollisionM = 1e-3f;
constexpr int kMaxVisited = 256;

}  // namespace

MoveResult slide(const Navmesh& navmesh, glm::vec3 from, glm::vec3 displacement) {
  displacement.y = 0;
  const float asked_m = std::hypot(displacement.x, displacement.z);
  const Navmesh::Impl& nav = navmesh.impl();
  const auto start = nav.locate(from, kReachM);
  if (!start || !std::isfinite(asked_m)) return {from, true};
  const bool on_surface = std::hypot(start->point.x - from.x, start->point.z - from.z) < kOnSurfaceM;
  if (!on_surface) from = start->point;
  if (asked_m == 0.f) return {from, false};

  const glm::vec3 target = from + displacement;
  glm::vec3 reached = from;
  dtPolyRef visited[kMaxVisited];
  int num_visited = 0;
  const dtStatus status = nav.queries.lease()->moveAlongSurface(nav.ref_of(start->polygon), &from.x, &target.x, &nav.any_island, &reached.x,
                                                                visited, &num_visited, kMaxVisited);
  const float covered_m = std::hypot(reached.x - from.x, reached.z - from.z);
  if (dtStatusFailed(status) || num_visited == 0 || covered_m < kStuckM) return {from, asked_m > kCollisionM};
  reached.y = nav.height_at(nav.polygon_of(visited[num_visited - 1]), reached);
  return {reached, covered_m < asked_m - kCollisionM};
}

}  // namespace earshot
