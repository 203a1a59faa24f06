// SPDX-License-Identifier: Apache-2.0
#include "sim/rays/bare_rays.h"

#include <cstring>
#include <limits>

#include "sim/base/errors.h"
#include "sim/rays/embree_options.h"
#include "sim/rays/embree_query.h"

namespace earshot {
namespace {

constexpr float kNearestM = 1e-3f;

}  // namespace

struct BareRays::Handles {
  EmbreeDevice device;
  EmbreeSceneHandle scene;
};

BareRays::BareRays(std::span<const glm::vec3> vertices, std::span<const glm::uvec3> triangles) : handles_(std::make_unique<Handles>()) {
  const auto check = [](bool fine) {
    if (!fine) throw InputError("ray tracer", "cannot load this mesh", "check the installation of libembree and the free memory");
  };
  handles_->device.reset(rtcNewDevice(embree_device_options().c_str()));
  check(handles_->device != nullptr);
  handles_->scene.reset(rtcNewScene(handles_->device.get()));
  check(handles_->scene != nullptr);
  const EmbreeGeometry mesh(rtcNewGeometry(handles_->device.get(), RTC_GEOMETRY_TYPE_TRIANGLE));
  check(mesh != nullptr);
  if (!triangles.empty()) {
    void* corners = rtcSetNewGeometryBuffer(mesh.get(), RTC_BUFFER_TYPE_VERTEX, 0, RTC_FORMAT_FLOAT3, sizeof(glm::vec3), vertices.size());
    void* indices = rtcSetNewGeometryBuffer(mesh.get(), RTC_BUFFER_TYPE_INDEX, 0, RTC_FORMAT_UINT3, sizeof(glm::uvec3), triangles.size());
    check(corners != nullptr && indices != nullptr);
    std::memcpy(corners, vertices.data(), vertices.size_bytes());
    std::memcpy(indices, triangles.data(), triangles.size_bytes());
  }
  rtcCommitGeometry(mesh.get());
  rtcAttachGeometry(handles_->scene.get(), mesh.get());
  rtcCommitScene(handles_->scene.get());
  check(rtcGetDeviceError(handles_->device.get()) == RTC_ERROR_NONE);
}

BareRays::~BareRays() = default;

void BareRays::closest16(glm::vec3 origin, const Directions16& directions, std::span<float, 16> distances_m) const {
  alignas(64) int valid[16];
  RTCRayHit16 query;
  for (std::size_t i = 0; i < 16; ++i) {
    valid[i] = -1;
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
  intersect_coherent(valid, handles_->scene.get(), query);
  for (std::size_t i = 0; i < 16; ++i) distances_m[i] = query.ray.tfar[i];
}

BareRays::Bounce BareRays::closest(glm::vec3 origin, glm::vec3 direction) const {
  RTCRayHit query{};
  query.ray.org_x = origin.x;
  query.ray.org_y = origin.y;
  query.ray.org_z = origin.z;
  query.ray.tnear = kNearestM;
  query.ray.dir_x = direction.x;
  query.ray.dir_y = direction.y;
  query.ray.dir_z = direction.z;
  query.ray.tfar = std::numeric_limits<float>::infinity();
  query.ray.mask = ~0u;
  query.hit.geomID = RTC_INVALID_GEOMETRY_ID;
  query.hit.instID[0] = RTC_INVALID_GEOMETRY_ID;
  EmbreeContext context;
  intersect_one(handles_->scene.get(), context, nullptr, query);
  const bool hit = query.hit.geomID != RTC_INVALID_GEOMETRY_ID;
  return {.distance_m = query.ray.tfar, .normal = hit ? glm::vec3(query.hit.Ng_x, query.hit.Ng_y, query.hit.Ng_z) : glm::vec3(0)};
}

}  // namespace earshot
