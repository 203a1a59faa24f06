// SPDX-License-Identifier: Apache-2.0
#include "sim/vision/embree_camera.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdint>
#include <glm/geometric.hpp>

#include "sim/base/denormals.h"
#include "sim/base/errors.h"
#include "sim/scene/color.h"

namespace earshot {
namespace {

/// Rays of a packet, and the side of the block of pixels that they are: the nearer their pixels, the more of the tree they share.
constexpr std::size_t kLanes = 16;
constexpr std::uint32_t kBlock = 4;

/// Weights of the corners of a triangle at a point of it; in double, as it may be a needle.
glm::vec3 weights_at(glm::dvec3 a, glm::dvec3 b, glm::dvec3 c, glm::dvec3 point) {
  const glm::dvec3 ab = b - a, ac = c - a, ap = point - a;
  const double bb = glm::dot(ab, ab), bc = glm::dot(ab, ac), cc = glm::dot(ac, ac), pb = glm::dot(ap, ab), pc = glm::dot(ap, ac);
  const double area2 = bb * cc - bc * bc;
  if (!(area2 > 0)) return {1.f, 0.f, 0.f};
  const double v = (cc * pb - bc * pc) / area2, w = (bb * pc - bc * pb) / area2;
  return {static_cast<float>(1 - v - w), static_cast<float>(v), static_cast<float>(w)};
}

glm::vec3 color_at(const VisualMesh& mesh, const Hit& hit) {
  const glm::uvec3 corners = mesh.triangles[hit.triangle];
  const glm::vec3 weights = weights_at(mesh.vertices[corners.x], mesh.vertices[corners.y], mesh.vertices[corners.z], hit.position);
  const auto blend = [&](const auto& values) {
    return weights.x * values[corners.x] + weights.y * values[corners.y] + weights.z * values[corners.z];
  };
  const Paint& paint = mesh.paints[mesh.triangle_paint[hit.triangle]];
  glm::vec3 color = paint.base_color * blend(mesh.colors);
  if (paint.texture != Paint::no_texture) color *= sample_bilinear(mesh.textures[paint.texture], blend(mesh.uvs));
  return color;
}

/// Bodies as a packet sees them: the nearest of each lane, and its colour.
struct BodiesInPacket {
  std::array<BodyHit, kLanes> hits;
  std::array<glm::vec3, kLanes> colors;
};

/// False: none of the lanes meets any, and `seen` is as it was.
bool intersect_bodies(std::span<const AgentBody> bodies, glm::vec3 eye, const Directions16& directions, BodiesInPacket& seen) {
  bool any_hit = false;
  for (const AgentBody& body : bodies) {
    // The ball around it first, for all lanes in one plain loop: most packets see no body.
    constexpr float kSlack = 1.001f;
    const glm::vec3 centre = body.foot + glm::vec3(0, 0.5f * body.height_m, 0) - eye;
    const float ball2 = kSlack * (body.radius_m * body.radius_m + 0.25f * body.height_m * body.height_m);
    const float beside2 = glm::dot(centre, centre) - ball2;
    const bool within = beside2 < 0;  // of the ball: any ray may meet the body
    std::array<std::int32_t, kLanes> possible;
    std::int32_t any_possible = 0;
    for (std::size_t lane = 0; lane < kLanes; ++lane) {
      const float along = directions.x[lane] * centre.x + directions.y[lane] * centre.y + directions.z[lane] * centre.z;
      possible[lane] = along * std::abs(along) >= beside2 ? 1 : 0;
      any_possible |= possible[lane];
    }
    if (within) {
      possible.fill(1);
      any_possible = 1;
    }
    if (any_possible == 0) continue;
    if (!any_hit) seen.hits.fill({});
    any_hit = true;
    for (std::size_t lane = 0; lane < kLanes; ++lane) {
      if (possible[lane] == 0) continue;
      const BodyHit hit = intersect(body, eye, {directions.x[lane], directions.y[lane], directions.z[lane]});
      if (!(hit.distance_m < seen.hits[lane].distance_m)) continue;
      seen.hits[lane] = hit;
      seen.colors[lane] = body.color;
    }
  }
  return any_hit;
}

}  // namespace

EmbreeCamera::EmbreeCamera(const CameraSensorConfig& config) : config_(config) {
  validate(config);
  const auto width = static_cast<std::uint32_t>(config.width_px), height = static_cast<std::uint32_t>(config.height_px);
  for (std::uint32_t top = 0; top < height; top += kBlock)
    for (std::uint32_t left = 0; left < width; left += kBlock)
      for (std::uint32_t row = top; row < std::min(top + kBlock, height); ++row)
        for (std::uint32_t column = left; column < std::min(left + kBlock, width); ++column) pixels_.push_back(row * width + column);
  while (pixels_.size() % kLanes != 0) pixels_.push_back(pixels_.back());
  const std::vector<glm::vec3> directions = pixel_directions(config);
  for (const std::uint32_t pixel : pixels_) {
    right_.push_back(directions[pixel].x);
    up_.push_back(directions[pixel].y);
    forward_.push_back(directions[pixel].z);
  }
}

Directions16 EmbreeCamera::directions_of(std::size_t packet, const CameraFrame& frame) const {
  Directions16 directions;
  const float *right = right_.data() + kLanes * packet, *up = up_.data() + kLanes * packet, *forward = forward_.data() + kLanes * packet;
  for (std::size_t lane = 0; lane < kLanes; ++lane) {
    directions.x[lane] = right[lane] * frame.right.x + up[lane] * frame.up.x + forward[lane] * frame.forward.x;
    directions.y[lane] = right[lane] * frame.right.y + up[lane] * frame.up.y + forward[lane] * frame.forward.y;
    directions.z[lane] = right[lane] * frame.right.z + up[lane] * frame.up.z + forward[lane] * frame.forward.z;
  }
  return directions;
}

void EmbreeCamera::render_depth(const Scene& scene, const CameraFrame& frame, std::span<const AgentBody> bodies,
                                std::span<float> depth) const {
  const bool along_axis = config_.projection == Projection::pinhole;
  alignas(64) std::array<float, kLanes> distances_m;
  BodiesInPacket seen;
  for (std::size_t packet = 0; packet < pixels_.size() / kLanes; ++packet) {
    const Directions16 directions = directions_of(packet, frame);
    scene.rays().intersect16(frame.eye, directions, std::span(distances_m));
    if (intersect_bodies(bodies, frame.eye, directions, seen))
      for (std::size_t lane = 0; lane < kLanes; ++lane) distances_m[lane] = std::min(distances_m[lane], seen.hits[lane].distance_m);
    for (std::size_t lane = 0; lane < kLanes; ++lane) {
      const std::size_t ray = kLanes * packet + lane;
      depth[pixels_[ray]] = std::min(distances_m[lane] * (along_axis ? forward_[ray] : 1.f) / config_.max_depth_m, 1.f);
    }
  }
}

void EmbreeCamera::render(const Scene& scene, const Appearance* appearance, const Pose& pose, const CameraImages& images,
                          std::span<const AgentBody> bodies) const {
  const FlushDenormals flush;
  check_sizes(config_, images);
  EARSHOT_EXPECT(appearance || !images.wants_appearance());
  EARSHOT_EXPECT(!appearance || appearance->triangle_color.size() == scene.mesh().triangles.size());
  const CameraFrame frame = frame_of(config_, pose);
  if (images.rgb.empty() && images.semantic.empty() && images.normals.empty()) {
    if (!images.depth.empty()) render_depth(scene, frame, bodies, images.depth);
    return;
  }
  const Appearance::Detail* detail = appearance && !images.rgb.empty() && appearance->detail ? &*appearance->detail : nullptr;
  const bool wants_scene = !images.depth.empty() || !images.semantic.empty() || !images.normals.empty() || (!images.rgb.empty() && !detail);
  const bool along_axis = config_.projection == Projection::pinhole;
  std::array<Hit, kLanes> surface, colored;
  BodiesInPacket bodies_seen;
  const std::uint16_t body_category = bodies.empty() || images.semantic.empty() ? std::uint16_t{0} : agent_category();

  for (std::size_t packet = 0; packet < pixels_.size() / kLanes; ++packet) {
    const Directions16 directions = directions_of(packet, frame);
    if (wants_scene) scene.rays().intersect16(frame.eye, directions, std::span(surface));
    if (detail) detail->rays.intersect16(frame.eye, directions, std::span(colored));
    const bool any_body = intersect_bodies(bodies, frame.eye, directions, bodies_seen);
    for (std::size_t lane = 0; lane < kLanes; ++lane) {
      const std::size_t ray = kLanes * packet + lane, pixel = pixels_[ray];
      const Hit& hit = surface[lane];
      const bool is_body = any_body && bodies_seen.hits[lane].distance_m < hit.distance_m;
      const glm::vec3 normal = is_body ? bodies_seen.hits[lane].normal : hit.normal;
      if (!images.depth.empty()) {
        // The local z is the cosine to the view axis: ray length becomes depth.
        const float distance_m = is_body ? bodies_seen.hits[lane].distance_m : hit.distance_m;
        images.depth[pixel] = std::min(distance_m * (along_axis ? forward_[ray] : 1.f) / config_.max_depth_m, 1.f);
      }
      if (!images.semantic.empty())
        images.semantic[pixel] = is_body ? body_category : hit.valid() ? appearance->triangle_category[hit.triangle] : std::uint16_t{0};
      if (!images.normals.empty()) {
        // Hit::normal is zero where nothing is hit.
        images.normals[3 * pixel] = glm::dot(normal, frame.right);
        images.normals[3 * pixel + 1] = glm::dot(normal, frame.up);
        images.normals[3 * pixel + 2] = -glm::dot(normal, frame.forward);
      }
      if (images.rgb.empty()) continue;
      const Hit& seen = detail ? colored[lane] : hit;
      std::array<std::uint8_t, 3> rgb{};
      if (any_body && bodies_seen.hits[lane].distance_m < seen.distance_m) {
        const glm::vec3 color = bodies_seen.colors[lane];
        rgb = to_srgb8(config_.unlit ? color : light_on(bodies_seen.hits[lane].normal) * color);
      } else if (seen.valid()) {
        const glm::vec3 color = detail ? color_at(detail->mesh, seen) : appearance->triangle_color[seen.triangle];
        rgb = to_srgb8(config_.unlit ? color : light_on(seen.normal) * color);
      }
      std::copy(rgb.begin(), rgb.end(), images.rgb.begin() + static_cast<std::ptrdiff_t>(3 * pixel));
    }
  }
}

}  // namespace earshot
