#include "sim/vision/camera.h"

#include <cmath>

#include "sim/base/errors.h"

namespace earshot {

void validate(const CameraConfig& config) {
  require(config.width_px >= 8 && config.width_px <= 4096 && config.width_px % 8 == 0, "camera.width_px", config.width_px,
          "must be a multiple of 8 from 8 to 4096: rays are traced in groups of eight");
  require(config.height_px >= 1 && config.height_px <= 4096, "camera.height_px", config.height_px, "must be 1 to 4096");
  require(config.horizontal_fov_deg > 1.f && config.horizontal_fov_deg < 179.f, "camera.horizontal_fov_deg", config.horizontal_fov_deg,
          "must be between 1 and 179: a pinhole camera sees less than 180 degrees");
  require(config.height_m > 0.f && config.height_m < 10.f, "camera.height_m", config.height_m, "must lie between 0 and 10");
  require(config.max_depth_m > 0.f && std::isfinite(config.max_depth_m), "camera.max_depth_m", config.max_depth_m,
          "must be positive and finite: it scales the depth");
}

glm::vec3 forward_of(double heading_rad) {
  return {static_cast<float>(-std::sin(heading_rad)), 0.f, static_cast<float>(-std::cos(heading_rad))};
}

glm::vec3 right_of(double heading_rad) {
  return {static_cast<float>(std::cos(heading_rad)), 0.f, static_cast<float>(-std::sin(heading_rad))};
}

}  // namespace earshot
