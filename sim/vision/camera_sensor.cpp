#include "sim/vision/camera_sensor.h"

#include <cmath>
#include <glm/geometric.hpp>
#include <numbers>

#include "sim/base/errors.h"

namespace earshot {
namespace {

constexpr double kRadiansPerDegree = std::numbers::pi / 180.0;

}  // namespace

void validate(const CameraSensorConfig& config) {
  const auto require_side = [](const char* key, int side) { require(side >= 1 && side <= 4096, key, side, "must be 1 to 4096"); };
  require_side("camera.width_px", config.width_px);
  require_side("camera.height_px", config.height_px);
  if (config.projection == Projection::pinhole) {
    require(config.horizontal_fov_deg > 1.f && config.horizontal_fov_deg < 179.f, "camera.horizontal_fov_deg", config.horizontal_fov_deg,
            "must be between 1 and 179: a pinhole camera sees less than 180 degrees");
  } else {
    require(config.horizontal_fov_deg >= 1.f && config.horizontal_fov_deg <= 360.f, "camera.horizontal_fov_deg", config.horizontal_fov_deg,
            "must be 1 to 360");
    const float vertical_deg = config.horizontal_fov_deg * static_cast<float>(config.height_px) / static_cast<float>(config.width_px);
    require(vertical_deg <= 180.001f, "camera.height_px", config.height_px,
            "must cover at most 180 degrees: horizontal_fov_deg * height_px / width_px");
  }
  const auto require_place = [](const char* key, float value) {
    require(value >= -10.f && value <= 10.f, key, value, "must be in [-10, 10]: the agent carries the camera");
  };
  require_place("camera.right_m", config.right_m);
  require_place("camera.up_m", config.up_m);
  require_place("camera.forward_m", config.forward_m);
  require(config.yaw_deg >= -360.f && config.yaw_deg <= 360.f, "camera.yaw_deg", config.yaw_deg, "must be in [-360, 360]");
  require(config.pitch_deg >= -90.f && config.pitch_deg <= 90.f, "camera.pitch_deg", config.pitch_deg, "must be in [-90, 90]");
  require(config.max_depth_m > 0.f && std::isfinite(config.max_depth_m), "camera.max_depth_m", config.max_depth_m,
          "must be positive and finite: it scales the depth");
}

CameraSensorConfig sensor_of(const CameraConfig& config) {
  return {.width_px = config.width_px,
          .height_px = config.height_px,
          .horizontal_fov_deg = config.horizontal_fov_deg,
          .up_m = config.height_m,
          .max_depth_m = config.max_depth_m};
}

CameraFrame frame_of(const CameraSensorConfig& config, const Pose& agent) {
  const double heading = agent.heading_rad + config.yaw_deg * kRadiansPerDegree, pitch = config.pitch_deg * kRadiansPerDegree;
  const glm::vec3 level = forward_of(heading), up(0.f, 1.f, 0.f);
  const auto cosine = static_cast<float>(std::cos(pitch)), sine = static_cast<float>(std::sin(pitch));
  CameraFrame frame;
  frame.right = right_of(heading);
  frame.forward = cosine * level + sine * up;
  frame.up = cosine * up - sine * level;
  frame.eye =
      agent.position + config.right_m * right_of(agent.heading_rad) + config.up_m * up + config.forward_m * forward_of(agent.heading_rad);
  return frame;
}

std::vector<glm::vec3> pixel_directions(const CameraSensorConfig& config) {
  std::vector<glm::vec3> directions;
  directions.reserve(static_cast<std::size_t>(config.width_px) * static_cast<std::size_t>(config.height_px));
  const bool pinhole = config.projection == Projection::pinhole;
  const double fov_rad = static_cast<double>(config.horizontal_fov_deg) * kRadiansPerDegree;
  const double half_width = std::tan(static_cast<double>(config.horizontal_fov_deg) * std::numbers::pi / 360.0);
  const double pixel = pinhole ? 2.0 * half_width / config.width_px : fov_rad / config.width_px;
  for (int row = 0; row < config.height_px; ++row)
    for (int column = 0; column < config.width_px; ++column) {
      const double right = (column + 0.5 - 0.5 * config.width_px) * pixel;
      const double up = (0.5 * config.height_px - row - 0.5) * pixel;
      if (pinhole) {
        const double inverse_length = 1.0 / std::sqrt(right * right + up * up + 1.0);
        directions.emplace_back(right * inverse_length, up * inverse_length, inverse_length);
      } else {
        directions.emplace_back(std::cos(up) * std::sin(right), std::sin(up), std::cos(up) * std::cos(right));
      }
    }
  return directions;
}

void check_sizes(const CameraSensorConfig& config, const CameraImages& images) {
  const std::size_t pixels = static_cast<std::size_t>(config.width_px) * static_cast<std::size_t>(config.height_px);
  EARSHOT_EXPECT(images.depth.empty() || images.depth.size() == pixels);
  EARSHOT_EXPECT(images.rgb.empty() || images.rgb.size() == 3 * pixels);
  EARSHOT_EXPECT(images.semantic.empty() || images.semantic.size() == pixels);
  EARSHOT_EXPECT(images.normals.empty() || images.normals.size() == 3 * pixels);
}

float light_on(glm::vec3 normal) {
  const float half_round = 0.5f + 0.5f * glm::dot(normal, kLightDirection);
  return kAmbientLight + kDirectedLight * half_round * half_round;
}

}  // namespace earshot
