// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstddef>
#include <cstdint>
#include <glm/vec3.hpp>
#include <span>
#include <vector>

#include "sim/vision/camera.h"

namespace earshot {

class ConfigReader;

/// How pixels become directions.
enum class Projection {
  pinhole,          ///< square pixels on a plane; depth is the distance along the view axis
  equirectangular,  ///< square pixels in angle, columns are yaw and rows are pitch; depth is the distance along the ray
};

/// A camera that an agent carries, for depth, colour, categories and normals.  Rows go top to bottom, columns left to right.
struct CameraSensorConfig {
  int width_px = 128, height_px = 128;  ///< 1 to 4096
  Projection projection = Projection::pinhole;
  /// Horizontal field of view: (1, 179) for a pinhole; [1, 360] for a panorama, whose height then covers horizontal_fov_deg * height /
  /// width,
  /// at most 180.
  float horizontal_fov_deg = 90.f;
  // Where it sits, from the agent's foot point, in the agent's own directions; each within 10 m.
  float right_m = 0.f, up_m = 1.25f, forward_m = 0.f;
  float yaw_deg = 0.f;       ///< to the left of the agent's heading, [-360, 360]
  float pitch_deg = 0.f;     ///< upwards, [-90, 90]
  float max_depth_m = 10.f;  ///< depth is divided by it and clipped to [0, 1]
  bool unlit = false;        ///< colours as they are, without light
};
/// Reads the fields by their names over `config`.  Throws InputError.
void read(ConfigReader& reader, CameraSensorConfig& config);
/// Throws InputError naming key, value and what is allowed.
void validate(const CameraSensorConfig& config);

/// The camera of the agents' depth sensor as one of these: the same depth, bit for bit.
CameraSensorConfig sensor_of(const CameraConfig& config);

/// Where a camera stands in the scene: unit axes and the eye.  right x up = -forward.
struct CameraFrame {
  glm::vec3 eye, right, up, forward;
};
CameraFrame frame_of(const CameraSensorConfig& config, const Pose& agent);

/// Unit directions of all pixels [height * width]: x to the right, y up, z along the view axis.
std::vector<glm::vec3> pixel_directions(const CameraSensorConfig& config);

/// What one camera at one pose sees; row-major [height, width, channels].  An empty span is not wanted and costs nothing.
struct CameraImages {
  std::span<float> depth = {};             ///< [H, W, 1] in [0, 1]; 1 beyond max_depth_m and where nothing is hit
  std::span<std::uint8_t> rgb = {};        ///< [H, W, 3] encoded sRGB; 0 where nothing is hit
  std::span<std::uint16_t> semantic = {};  ///< [H, W, 1] index into category_names(); 0 for unknown things and where nothing is hit
  std::span<float> normals = {};  ///< [H, W, 3] unit, toward the camera, in its frame: x right, y up, z back; 0 where nothing is hit
  [[nodiscard]] bool wants_appearance() const { return !rgb.empty() || !semantic.empty(); }
};
/// Ends the process if a span that is not empty has another size than config says.
void check_sizes(const CameraSensorConfig& config, const CameraImages& images);

/// Light of all renderers: from above and aside, half round the corner, never dark (docs/howto/vision.md).
/// Factor for a base colour in linear light; normal: unit, in the scene, toward the viewer.
inline constexpr glm::vec3 kLightDirection{0.35629062f, 0.81437856f, 0.45808794f};  // (0.35, 0.8, 0.45), unit
inline constexpr float kAmbientLight = 0.35f, kDirectedLight = 0.65f;
float light_on(glm::vec3 normal);

}  // namespace earshot
