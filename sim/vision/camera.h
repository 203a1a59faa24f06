// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <glm/vec3.hpp>

namespace earshot {

class ConfigReader;

/// Pinhole camera.  Rows go top to bottom, columns left to right, as seen by the agent.
struct CameraConfig {
  int width_px = 128, height_px = 128;  ///< width a multiple of 8
  float horizontal_fov_deg = 90.f;      ///< (1, 179)
  float height_m = 1.25f;               ///< above the agent's foot point
  float max_depth_m = 10.f;
};
/// Reads the fields by their names over `config`.  Throws InputError.
void read(ConfigReader& reader, CameraConfig& config);
/// Throws InputError naming key, value and what is allowed.
void validate(const CameraConfig& config);

/// Where the agent stands: foot point on the floor and heading, counter-clockwise from -z seen from above.
struct Pose {
  glm::vec3 position{0};
  double heading_rad = 0;
};

/// Unit vector along the view axis of an agent with this heading: (-sin h, 0, -cos h).
glm::vec3 forward_of(double heading_rad);
/// Unit vector to its right: (cos h, 0, -sin h).
glm::vec3 right_of(double heading_rad);

}  // namespace earshot
