// SPDX-License-Identifier: Apache-2.0
#include "sim/vision/camera_sensor.h"

#include <cmath>
#include <glm/geometric.hpp>
#include <numbers>

#include "sim/base/errors.h"
#include "sim/base/text/config_reader.h"

namespace earshot {
namespace {

constexpr double kRadiansPerDegree = std::numbers::pi / 180.0;

}  // namespace

void read(ConfigReader& reader, CameraSensorConfig& config) {
  reader.read("width_px", config.width_px, Allowed::between(1, 4096), "Width of its pictures.");
  reader.read("height_px", config.height_px, Allowed::between(1, 4096), "Height of its pictures.");
  reader.read_choice<Projection>("projection", config.projection,
                                 {{"pinhole", Projection::pinhole}, {"equirectangular", Projection::equirectangular}},
                                 "Projection: a pinhole camera, or a panorama with equal angles per pixel.");
  reader.read("horizontal_fov_deg", config.horizontal_fov_deg, Allowed::between(1, 360),
              "Angle over the width; of a pinhole above 1 and below 179.");
  const Allowed near_agent = Allowed::between(-10, 10).because("the agent carries the camera");
  reader.read("right_m", config.right_m, near_agent, "Place of the camera to the right of the agent.");
  reader.read("up_m", config.up_m, near_agent, "Place of the camera above the floor.");
  reader.read("forward_m", config.forward_m, near_agent, "Place of the camera ahead of the agent.");
  reader.read("yaw_deg", config.yaw_deg, Allowed::between(-360, 360), "Direction of the camera to the left of the agent's heading.");
  reader.read("pitch_deg", config.pitch_deg, Allowed::between(-90, 90), "Direction of the camera upwards.");
  reader.read("max_depth_m", config.max_depth_m, Allowed::above(0).because("depth is divided by it"),
              "Distance that depth is divided by and clipped to.");
  reader.read("unlit", config.unlit, "Colours without light.");
}

void validate(const CameraSensorConfig& config) {
  check_values(config, "camera");
  if (config.projection == Projection::pinhole) {
    require(config.horizontal_fov_deg > 1.f && config.horizontal_fov_deg < 179.f, "camera.horizontal_fov_deg", config.horizontal_fov_deg,
            "must be between 1 and 179: a pinhole camera sees less than 180 degrees");
    return;
  }
  const float vertical_deg = config.horizontal_fov_deg * static_cast<float>(config.height_px) / static_cast<float>(config.width_px);
  require(vertical_deg <= 180.001f, "camera.height_px", config.height_px,
          "must cover at most 180 degrees: horizontal_fov_deg * height_px / width_px");
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
