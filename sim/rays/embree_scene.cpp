// SPDX-License-Identifier: Apache-2.0
#include "sim/rays/embree_scene.h"

#include <algorithm>
#include <atomic>
#include <bit>
#include <cmath>
#include <cstddef>
#include <cstring>
#include <glm/geometric.hpp>
#include <mutex>
#include <string>
#include <tuple>
#include <vector>

#include "sim/base/errors.h"
#include "sim/rays/certain_block.h"
#include "sim/rays/embree_options.h"
#include "sim/rays/embree_query.h"
#include "sim/rays/hit_surface.h"

namespace earshot {
namespace {

/// First message that Embree reported.  Its builder calls back from worker threads.
struct ErrorLog {
  std::mutex mutex;
  std::string first;
};

void keep_first_error(void* log_pointer, RTCError code, const char* text) {
  auto& log = *static_cast<ErrorLog*>(log_pointer);
  const std::lock_guard lock(log.mutex);
  if (log.first.empty()) log.first = "Embree error " + std::to_string(code) + (text ? std::string(": ") + text : "");
}

/// Embree tells of its memory as it takes it and gives it back, from any of its threads.
bool count_bytes(void* counter, ssize_t bytes, bool) {
  static_cast<std::atomic<std::ptrdiff_t>*>(counter)->fetch_add(bytes, std::memory_order_relaxed);
  return true;  // go on
}

[[noreturn]] void fail(const std::string& problem) {
  throw InputError("ray tracer", problem, "check the installation of libembree and the free memory (earshot doctor)");
}

// A query's context with the winner so far.  Embree hands it back to the filter by address.
struct TieContext {
  EmbreeContext base;                           // first, so that the addresses agree
  float origin_size;                            // largest coordinate of the ray's origin
  const HitSurface* surfaces;                   // of all triangles
  unsigned triangle = RTC_INVALID_GEOMETRY_ID;  // the winner
  Crossing crossing;                            // with the winner
  float normal[3];                              // of the winner, not normalised
};

// Overlapping coplanar triangles differ in distance only by rounding, so "the nearest" would be chosen by the direction of the
// ray.  Among parallel triangles within the rounding of the coordinates, the lowest id wins.  Otherwise the nearest does.
void prefer_lowest_id(const RTCFilterFunctionNArguments* arguments) {
  if (arguments->valid[0] == 0) return;
  auto& context = *reinterpret_cast<TieContext*>(arguments->context);
  auto& ray = *reinterpret_cast<RTCRay*>(arguments->ray);
  const auto& hit = *reinterpret_cast<const RTCHit*>(arguments->hit);
  const float dot = hit.Ng_x * ray.dir_x + hit.Ng_y * ray.dir_y + hit.Ng_z * ray.dir_z;
  const float length2 = hit.Ng_x * hit.Ng_x + hit.Ng_y * hit.Ng_y + hit.Ng_z * hit.Ng_z;
  // Rounding moves the plane by about 1e-6 of the coordinates; along a slanted ray that is 1 / cos longer.
  constexpr float plane_rounding = 1e-6f, least_cosine = 1e-3f;
  const float cosine = std::max(std::fabs(dot) / std::sqrt(std::max(length2, 1e-38f)), least_cosine);
  const ExactRay exact(context.surfaces[hit.primID], {ray.org_x, ray.org_y, ray.org_z}, {ray.dir_x, ray.dir_y, ray.dir_z});
  const Crossing crossing = exact.crossing_or({ray.tfar, hit.u, hit.v});
  const float band = plane_rounding * (context.origin_size + crossing.distance) / cosine;

  if (context.triangle != RTC_INVALID_GEOMETRY_ID) {
    const float* n = context.normal;
    const float along = n[0] * hit.Ng_x + n[1] * hit.Ng_y + n[2] * hit.Ng_z;
    const float winner_length2 = n[0] * n[0] + n[1] * n[1] + n[2] * n[2];
    const bool parallel = along * along >= 0.99999f * length2 * winner_length2;
    const float farther = crossing.distance - context.crossing.distance;
    const bool tied = farther == 0 || (parallel && std::fabs(farther) <= band);
    const bool wins = tied ? hit.primID < context.triangle : farther < 0;
    if (!wins) {
      arguments->valid[0] = 0;
      return;
    }
  }
  context.crossing = crossing;
  context.normal[0] = hit.Ng_x;
  context.normal[1] = hit.Ng_y;
  context.normal[2] = hit.Ng_z;
  context.triangle = hit.primID;
  // Search behind the winner as far as a tie reaches.
  ray.tfar = std::max(ray.tfar, crossing.distance) + band;
}

/// Half the spacing of floats at the farthest coordinate: a surface nearer than that to a point contains the point.  An eighth of
/// the margin that hits keep from edges, so that the next wall is never taken for the one that a ray starts from.
float rounding_of(glm::vec3 point) { return 0x1p-24f * std::max({std::fabs(point.x), std::fabs(point.y), std::fabs(point.z), 1e-30f}); }

/// Embree ends the process on a ray from 1e30 m.  Scenes end at 1e9 m: a ray from beyond this, or from NaN, hits nothing.
constexpr float farthest_m = 1e15f;

bool is_near(glm::vec3 point) {  // not so for NaN
  return std::fabs(point.x) <= farthest_m && std::fabs(point.y) <= farthest_m && std::fabs(point.z) <= farthest_m;
}

/// A segment between two points, its query, and the triangle that blocks it.
struct Segment {
  EmbreeContext base;  // first, so that the addresses agree
  RTCRay ray;
  float margin;                // of both ends, as a fraction of the segment
  const HitSurface* surfaces;  // of all triangles
  unsigned blocker = RTC_INVALID_GEOMETRY_ID;

  Segment(glm::vec3 from, glm::vec3 to, const HitSurface* surfaces_of_scene) : surfaces(surfaces_of_scene) {
    // Both directions of a segment must agree (reciprocity), and rounding at edges depends on the ray's origin: fix the order.
    if (std::tie(to.x, to.y, to.z) < std::tie(from.x, from.y, from.z)) std::swap(from, to);
    const glm::vec3 along = to - from;
    margin = std::min(0.25f, std::max(rounding_of(from), rounding_of(to)) / std::max(glm::length(along), 1e-30f));
    ray = {.org_x = from.x,
           .org_y = from.y,
           .org_z = from.z,
           .tnear = 0.f,
           .dir_x = along.x,
           .dir_y = along.y,
           .dir_z = along.z,
           .time = 0.f,
           .tfar = 1.f,
           .mask = ~0u,
           .id = 0,
           .flags = 0};
  }
};

/// An open segment: surfaces at its ends do not block it.  Embree's distances are too rough to tell.
void keep_blocker(const RTCFilterFunctionNArguments* arguments) {
  if (arguments->valid[0] == 0) return;
  auto& segment = *reinterpret_cast<Segment*>(arguments->context);
  const auto& ray = *reinterpret_cast<const RTCRay*>(arguments->ray);
  const auto& hit = *reinterpret_cast<const RTCHit*>(arguments->hit);
  const ExactRay exact(segment.surfaces[hit.primID], {ray.org_x, ray.org_y, ray.org_z}, {ray.dir_x, ray.dir_y, ray.dir_z});
  const float distance = exact.distance_or(ray.tfar);
  if (distance > segment.margin && distance < 1.f - segment.margin) {
    segment.blocker = hit.primID;
  } else {
    arguments->valid[0] = 0;
  }
}

}  // namespace

struct EmbreeScene::Handles {
  ErrorLog errors;  // these two outlive the device that writes to them
  std::atomic<std::ptrdiff_t> embree_bytes{0};
  EmbreeDevice device;
  EmbreeSceneHandle scene;
  std::span<const glm::uvec3> traced;  // in a buffer of the scene's geometry
  std::vector<HitSurface> surfaces;    // [traced]

  [[nodiscard]] RTCRayHit8 trace8(std::span<const glm::vec3, 8> origins, std::span<const glm::vec3, 8> directions) const {
    alignas(32) int valid[8];
    RTCRayHit8 query{};
    for (std::size_t i = 0; i < 8; ++i) {
      valid[i] = is_near(origins[i]) && is_near(directions[i]) ? -1 : 0;
      query.ray.org_x[i] = origins[i].x;
      query.ray.org_y[i] = origins[i].y;
      query.ray.org_z[i] = origins[i].z;
      query.ray.dir_x[i] = directions[i].x;
      query.ray.dir_y[i] = directions[i].y;
      query.ray.dir_z[i] = directions[i].z;
      query.ray.tfar[i] = std::numeric_limits<float>::infinity();
      query.ray.mask[i] = ~0u;
      query.hit.geomID[i] = RTC_INVALID_GEOMETRY_ID;
      query.hit.instID[0][i] = RTC_INVALID_GEOMETRY_ID;
    }
    intersect_coherent(valid, scene.get(), query);
    return query;
  }

  [[nodiscard]] RTCRayHit16 trace16(glm::vec3 origin, const Directions16& directions) const {
    alignas(64) int valid[16];
    RTCRayHit16 query;
    const bool starts_near = is_near(origin);
    for (std::size_t i = 0; i < 16; ++i) {
      valid[i] = starts_near && is_near({directions.x[i], directions.y[i], directions.z[i]}) ? -1 : 0;
      query.ray.org_x[i] = origin.x;
      query.ray.org_y[i] = origin.y;
      query.ray.org_z[i] = origin.z;
      query.ray.tnear[i] = 0.f;
      query.ray.dir_x[i] = directions.x[i];
      query.ray.dir_y[i] = directions.y[i];
      query.ray.dir_z[i] = directions.z[i];
      query.ray.time[i] = 0.f;
      query.ray.tfar[i] = std::numeric_limits<float>::infinity();
      query.ray.mask[i] = ~0u;
      query.ray.id[i] = query.ray.flags[i] = 0;
      query.hit.geomID[i] = RTC_INVALID_GEOMETRY_ID;
      query.hit.instID[0][i] = RTC_INVALID_GEOMETRY_ID;
    }
    intersect_coherent(valid, scene.get(), query);
    return query;
  }

  /// Of one ray of a packet; infinity where it escapes.
  template <class Packet>
  [[nodiscard]] float distance(const Packet& query, std::size_t ray, glm::vec3 origin, glm::vec3 direction) const {
    if (query.hit.geomID[ray] == RTC_INVALID_GEOMETRY_ID) return query.ray.tfar[ray];
    return ExactRay(surfaces[query.hit.primID[ray]], origin, direction).distance_or(query.ray.tfar[ray]);
  }

  void throw_on_error(const char* doing) {
    const std::lock_guard lock(errors.mutex);
    if (!errors.first.empty()) fail(std::string(doing) + ": " + errors.first);
  }
};

glm::vec3 offset_from_surface(glm::vec3 position, glm::vec3 normal) {
  constexpr float near_origin = 1.f / 32.f, float_step = 1.f / 65536.f, integer_step = 256.f;
  glm::vec3 moved;
  for (int axis = 0; axis < 3; ++axis) {
    const float p = position[axis], n = normal[axis];
    // Unsigned, as the bits of -0 less one step would overflow a signed integer (that result is not used).
    const auto steps = static_cast<std::uint32_t>(static_cast<std::int32_t>(integer_step * n));
    const float stepped = std::bit_cast<float>(std::bit_cast<std::uint32_t>(p) + (p < 0 ? 0u - steps : steps));
    moved[axis] = std::fabs(p) < near_origin ? p + float_step * n : stepped;
  }
  // Steps are of each coordinate's own spacing: where those differ the sum leans to a side, and near an edge that is through the
  // neighbouring wall (2e-5 of the bounces in a tilted cube beside the origin).  Its part along the normal does as much.
  const glm::vec3 lean = moved - position;
  const bool straight = (normal.x != 0) + (normal.y != 0) + (normal.z != 0) == 1;
  return straight ? moved : position + glm::dot(lean, normal) * normal;
}

EmbreeScene::EmbreeScene(std::span<const glm::vec3> vertices, std::span<const glm::uvec3> triangles)
    : EmbreeScene(vertices, triangles, {}) {}

EmbreeScene::EmbreeScene(std::span<const glm::vec3> vertices, std::span<const glm::uvec3> traced, std::span<const std::uint32_t> stands_for)
    : handles_(std::make_unique<Handles>()) {
  Handles& h = *handles_;
  h.device.reset(rtcNewDevice(embree_device_options().c_str()));
  if (!h.device) fail("rtcNewDevice failed, Embree error " + std::to_string(rtcGetDeviceError(nullptr)));
  rtcSetDeviceErrorFunction(h.device.get(), keep_first_error, &h.errors);
  rtcSetDeviceMemoryMonitorFunction(h.device.get(), count_bytes, &h.embree_bytes);
  h.scene.reset(rtcNewScene(h.device.get()));
  if (!h.scene) fail("rtcNewScene failed");
  // Robust: conservative boxes and watertight edges, so that rays cannot slip between neighbouring triangles.
  // The filter of a query is what settles ties between coplanar triangles.
  rtcSetSceneFlags(h.scene.get(), RTC_SCENE_FLAG_ROBUST | kFilterPerQuery);

  if (!traced.empty()) {
    const EmbreeGeometry geometry{rtcNewGeometry(h.device.get(), RTC_GEOMETRY_TYPE_TRIANGLE)};
    if (!geometry) fail("rtcNewGeometry failed");
    void* vertex_buffer =
        rtcSetNewGeometryBuffer(geometry.get(), RTC_BUFFER_TYPE_VERTEX, 0, RTC_FORMAT_FLOAT3, sizeof(glm::vec3), vertices.size());
    void* index_buffer =
        rtcSetNewGeometryBuffer(geometry.get(), RTC_BUFFER_TYPE_INDEX, 0, RTC_FORMAT_UINT3, sizeof(glm::uvec3), traced.size());
    h.throw_on_error("allocating the triangles");
    if (!vertex_buffer || !index_buffer) fail("allocating the triangles failed");
    std::memcpy(vertex_buffer, vertices.data(), vertices.size_bytes());
    std::memcpy(index_buffer, traced.data(), traced.size_bytes());
    h.traced = {static_cast<const glm::uvec3*>(index_buffer), traced.size()};
    allow_filter_per_query(geometry.get());
    rtcCommitGeometry(geometry.get());
    rtcAttachGeometryByID(h.scene.get(), geometry.get(), 0);
  }
  rtcCommitScene(h.scene.get());
  h.throw_on_error("building the ray structure");

  EARSHOT_EXPECT(stands_for.empty() || stands_for.size() == traced.size());
  h.surfaces.reserve(traced.size());
  for (std::uint32_t i = 0; i < traced.size(); ++i) {
    const glm::uvec3 t = traced[i];
    h.surfaces.push_back(hit_surface_of(vertices[t.x], vertices[t.y], vertices[t.z]));
    h.surfaces.back().triangle = stands_for.empty() ? i : stands_for[i];
  }
}

EmbreeScene::~EmbreeScene() = default;
EmbreeScene::EmbreeScene(EmbreeScene&&) noexcept = default;
EmbreeScene& EmbreeScene::operator=(EmbreeScene&&) noexcept = default;

std::size_t EmbreeScene::num_triangles() const { return handles_->surfaces.size(); }

std::span<const glm::uvec3> EmbreeScene::traced() const { return handles_->traced; }

std::uint32_t EmbreeScene::stands_for(std::uint32_t traced) const { return handles_->surfaces[traced].triangle; }

std::size_t EmbreeScene::bytes() const {
  const std::ptrdiff_t of_embree = std::max<std::ptrdiff_t>(handles_->embree_bytes.load(std::memory_order_relaxed), 0);
  return static_cast<std::size_t>(of_embree) + handles_->surfaces.capacity() * sizeof(HitSurface) + sizeof(Handles);
}

Hit EmbreeScene::intersect(glm::vec3 origin, glm::vec3 direction, float max_distance_m) const {
  if (!is_near(origin) || !is_near(direction)) return {};
  TieContext context;
  context.origin_size = std::max({std::fabs(origin.x), std::fabs(origin.y), std::fabs(origin.z)});
  context.surfaces = handles_->surfaces.data();
  RTCRayHit query{};
  query.ray = {.org_x = origin.x,
               .org_y = origin.y,
               .org_z = origin.z,
               .tnear = rounding_of(origin),
               .dir_x = direction.x,
               .dir_y = direction.y,
               .dir_z = direction.z,
               .time = 0.f,
               .tfar = max_distance_m,
               .mask = ~0u,
               .id = 0,
               .flags = 0};
  query.hit.geomID = RTC_INVALID_GEOMETRY_ID;
  query.hit.instID[0] = RTC_INVALID_GEOMETRY_ID;
  intersect_one(handles_->scene.get(), context.base, prefer_lowest_id, query);
  if (query.hit.geomID == RTC_INVALID_GEOMETRY_ID) return {};
  return hit_on(handles_->surfaces[query.hit.primID], context.crossing, direction);
}

bool EmbreeScene::occluded(glm::vec3 from, glm::vec3 to) const {
  std::uint32_t blocker = Hit::no_triangle;
  return occluded(from, to, blocker);
}

bool EmbreeScene::occluded(glm::vec3 from, glm::vec3 to, std::uint32_t& blocker) const {
  if (!is_near(from) || !is_near(to)) return true;  // outside of all scenes
  if (blocker < handles_->surfaces.size()) {
    const HitSurface& surface = handles_->surfaces[blocker];
    if (certainly_blocks(surface.a, surface.b, surface.c, from, to)) return true;
  }
  Segment segment(from, to, handles_->surfaces.data());
  occlude_one(handles_->scene.get(), segment.base, keep_blocker, segment.ray);
  if (!(segment.ray.tfar < 0)) return false;
  blocker = segment.blocker;
  return true;
}

void EmbreeScene::intersect8(std::span<const glm::vec3, 8> origins, std::span<const glm::vec3, 8> directions,
                             std::span<float, 8> distances_m) const {
  const RTCRayHit8 query = handles_->trace8(origins, directions);
  for (std::size_t i = 0; i < 8; ++i) distances_m[i] = handles_->distance(query, i, origins[i], directions[i]);
}

void EmbreeScene::intersect16(glm::vec3 origin, const Directions16& directions, std::span<float, 16> distances_m) const {
  const RTCRayHit16 query = handles_->trace16(origin, directions);
  for (std::size_t i = 0; i < 16; ++i)
    distances_m[i] = handles_->distance(query, i, origin, {directions.x[i], directions.y[i], directions.z[i]});
}

void EmbreeScene::intersect16(glm::vec3 origin, const Directions16& directions, std::span<Hit, 16> hits) const {
  const RTCRayHit16 query = handles_->trace16(origin, directions);
  for (std::size_t i = 0; i < 16; ++i) {
    hits[i] = {};
    if (query.hit.geomID[i] == RTC_INVALID_GEOMETRY_ID) continue;
    const glm::vec3 direction(directions.x[i], directions.y[i], directions.z[i]);
    const HitSurface& surface = handles_->surfaces[query.hit.primID[i]];
    const Crossing of_embree{query.ray.tfar[i], query.hit.u[i], query.hit.v[i]};
    hits[i] = hit_on(surface, ExactRay(surface, origin, direction).crossing_or(of_embree), direction);
  }
}

}  // namespace earshot
