#pragma once

#include <array>
#include <glm/vec3.hpp>
#include <string>
#include <vector>

namespace earshot {

/// One continuous AV-Nav episode, the AudioNav JSON fields of docs/formats.md, section 1.
struct Episode {
  std::string episode_id;
  std::string scene_id;                             ///< a SCENE of the command line, or a path under the scene root
  glm::dvec3 start_position{0};                     ///< foot point, in the coordinates of the scene's file
  std::array<float, 4> start_rotation{0, 0, 0, 1};  ///< quaternion x, y, z, w; only its heading is used
  glm::dvec3 goal_position{0};                      ///< foot point under the source, as start_position
  float goal_radius_m = 1e-5f;
  float geodesic_distance_m = 0;  ///< start to goal; finite and positive
  int num_action = 0;             ///< actions of the oracle with this task's step sizes, stop included
  std::string sound;              ///< `synth:...` or a file, see open_sound
};

/// Heading (counter-clockwise from -z, radians) of a quaternion x, y, z, w; the quaternion is normalised first.  Throws InputError for zero
/// or NaN.
double heading_of(const std::array<float, 4>& rotation);
std::array<float, 4> rotation_of(double heading_rad);

}  // namespace earshot
