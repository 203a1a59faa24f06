// SPDX-License-Identifier: Apache-2.0
#include "sim/vision/camera.h"

#include <cmath>

#include "sim/base/errors.h"
#include "sim/base/text/config_reader.h"

namespace earshot {

void read(ConfigReader& reader, CameraConfig& config) {
  reader.read("width_px", config.width_px, Allowed::between(8, 4096).multiple_of(8).because("rays are traced in groups of eight"),
              "Width of its pictures.");
  reader.read("height_px", config.height_px, Allowed::between(1, 4096), "Height of its pictures.");
  reader.read("horizontal_fov_deg", config.horizontal_fov_deg,
              Allowed::above(1).below(179).because("a pinhole camera sees less than 180 degrees"), "Horizontal field of view.");
  reader.read("height_m", config.height_m, Allowed::above(0).below(10), "Height above the floor.");
  reader.read("max_depth_m", config.max_depth_m, Allowed::above(0).because("depth is divided by it"),
              "Distance that depth is divided by and clipped to.");
}

void validate(const CameraConfig& config) { check_values(config, "camera"); }

glm::vec3 forward_of(double heading_rad) {
  return {static_cast<float>(-std::sin(heading_rad)), 0.f, static_cast<float>(-std::cos(heading_rad))};
}

glm::vec3 right_of(double heading_rad) {
  return {static_cast<float>(std::cos(heading_rad)), 0.f, static_cast<float>(-std::sin(heading_rad))};
}

}  // namespace earshot
