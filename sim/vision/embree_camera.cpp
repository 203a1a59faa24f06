#include "sim/vision/embree_camera.h"

#include <algorithm>
#include <array>
#include <glm/geometric.hpp>

#include "sim/base/denormals.h"
#include "sim/base/errors.h"
#include "sim/scene/color.h"

namespace earshot {
namespace {

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

}  // namespace

EmbreeCamera::EmbreeCamera(const CameraSensorConfig& config) : config_(config) {
  validate(config);
  directions_ = pixel_directions(config);
}

void EmbreeCamera::render_depth(const Scene& scene, const CameraFrame& frame, std::span<float> depth) const {
  const bool along_axis = config_.projection == Projection::pinhole;
  std::array<glm::vec3, 8> origins, directions;
  std::array<float, 8> distances_m;
  origins.fill(frame.eye);
  for (std::size_t first = 0; first < directions_.size(); first += 8) {
    const std::size_t count = std::min<std::size_t>(8, directions_.size() - first);
    for (std::size_t lane = 0; lane < 8; ++lane) {
      const glm::vec3 local = directions_[first + std::min(lane, count - 1)];
      directions[lane] = local.x * frame.right + local.y * frame.up + local.z * frame.forward;
    }
    scene.rays().intersect8(origins, directions, std::span<float, 8>(distances_m));
    for (std::size_t lane = 0; lane < count; ++lane) {
      const float along = along_axis ? directions_[first + lane].z : 1.f;
      depth[first + lane] = std::min(distances_m[lane] * along / config_.max_depth_m, 1.f);
    }
  }
}

/// Eight pixels of the picture, fewer at its end, where the last one is repeated.
struct EmbreeCamera::Packet {
  std::array<glm::vec3, 8> origins, directions;
  std::array<Hit, 8> hits;
};

void EmbreeCamera::trace(const EmbreeScene& rays, const CameraFrame& frame, std::size_t first, Packet& packet) const {
  for (std::size_t lane = 0; lane < 8; ++lane) {
    const glm::vec3 local = directions_[std::min(first + lane, directions_.size() - 1)];
    packet.directions[lane] = local.x * frame.right + local.y * frame.up + local.z * frame.forward;
  }
  rays.intersect8(packet.origins, packet.directions, std::span<Hit, 8>(packet.hits));
}

void EmbreeCamera::render(const Scene& scene, const Appearance* appearance, const Pose& pose, const CameraImages& images) const {
  const FlushDenormals flush;
  check_sizes(config_, images);
  EARSHOT_EXPECT(appearance || !images.wants_appearance());
  EARSHOT_EXPECT(!appearance || appearance->triangle_color.size() == scene.mesh().triangles.size());
  const CameraFrame frame = frame_of(config_, pose);
  if (images.rgb.empty() && images.semantic.empty() && images.normals.empty()) {
    if (!images.depth.empty()) render_depth(scene, frame, images.depth);
    return;
  }
  const Appearance::Detail* detail = appearance && !images.rgb.empty() && appearance->detail ? &*appearance->detail : nullptr;
  const bool wants_scene = !images.depth.empty() || !images.semantic.empty() || !images.normals.empty() || (!images.rgb.empty() && !detail);
  const bool along_axis = config_.projection == Projection::pinhole;
  Packet surface, colored;
  surface.origins.fill(frame.eye);
  colored.origins.fill(frame.eye);

  for (std::size_t first = 0; first < directions_.size(); first += 8) {
    if (wants_scene) trace(scene.rays(), frame, first, surface);
    if (detail) trace(detail->rays, frame, first, colored);
    const std::size_t count = std::min<std::size_t>(8, directions_.size() - first);
    for (std::size_t lane = 0; lane < count; ++lane) {
      const std::size_t pixel = first + lane;
      const Hit& hit = surface.hits[lane];
      if (!images.depth.empty()) {
        // The local z is the cosine to the view axis: ray length becomes depth.
        const float along = along_axis ? directions_[pixel].z : 1.f;
        images.depth[pixel] = std::min(hit.distance_m * along / config_.max_depth_m, 1.f);
      }
      if (!images.semantic.empty()) images.semantic[pixel] = hit.valid() ? appearance->triangle_category[hit.triangle] : std::uint16_t{0};
      if (!images.normals.empty()) {
        // Hit::normal is zero where nothing is hit.
        images.normals[3 * pixel] = glm::dot(hit.normal, frame.right);
        images.normals[3 * pixel + 1] = glm::dot(hit.normal, frame.up);
        images.normals[3 * pixel + 2] = -glm::dot(hit.normal, frame.forward);
      }
      if (images.rgb.empty()) continue;
      const Hit& seen = detail ? colored.hits[lane] : hit;
      std::array<std::uint8_t, 3> rgb{};
      if (seen.valid()) {
        const glm::vec3 color = detail ? color_at(detail->mesh, seen) : appearance->triangle_color[seen.triangle];
        rgb = to_srgb8(config_.unlit ? color : light_on(seen.normal) * color);
      }
      std::copy(rgb.begin(), rgb.end(), images.rgb.begin() + static_cast<std::ptrdiff_t>(3 * pixel));
    }
  }
}

}  // namespace earshot
