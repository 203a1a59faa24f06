#include "sim/vision/ray_renderer.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <numbers>

#include "sim/base/denormals.h"
#include "sim/base/errors.h"

namespace earshot {

RayRenderer::RayRenderer(const CameraConfig& config) : config_(config) {
  validate(config);
  const double half_width = std::tan(static_cast<double>(config.horizontal_fov_deg) * std::numbers::pi / 360.0);
  const double pixel = 2.0 * half_width / config.width_px;  // square pixels, on the plane one metre ahead
  directions_.reserve(static_cast<std::size_t>(config.width_px) * static_cast<std::size_t>(config.height_px));
  for (int row = 0; row < config.height_px; ++row)
    for (int column = 0; column < config.width_px; ++column) {
      const double right = (column + 0.5 - 0.5 * config.width_px) * pixel;
      const double up = (0.5 * config.height_px - row - 0.5) * pixel;
      const double inverse_length = 1.0 / std::sqrt(right * right + up * up + 1.0);
      directions_.emplace_back(right * inverse_length, up * inverse_length, inverse_length);
    }
}

void RayRenderer::render_depth(const Scene& scene, const Pose& pose, std::span<float> depth) const {
  const FlushDenormals flush;
  EARSHOT_EXPECT(depth.size() == directions_.size());
  const glm::vec3 forward = forward_of(pose.heading_rad), right = right_of(pose.heading_rad);
  const glm::vec3 eye = pose.position + glm::vec3(0.f, config_.height_m, 0.f);
  std::array<glm::vec3, 8> origins, directions;
  std::array<float, 8> distances_m;
  origins.fill(eye);
  for (std::size_t first = 0; first < directions_.size(); first += 8) {
    for (std::size_t lane = 0; lane < 8; ++lane) {
      const glm::vec3 local = directions_[first + lane];
      directions[lane] = local.x * right + local.z * forward;
      directions[lane].y = local.y;
    }
    scene.rays().intersect8(origins, directions, distances_m);
    // The local z is the cosine to the view axis: ray length becomes depth.
    for (std::size_t lane = 0; lane < 8; ++lane)
      depth[first + lane] = std::min(distances_m[lane] * directions_[first + lane].z / config_.max_depth_m, 1.f);
  }
}

}  // namespace earshot
