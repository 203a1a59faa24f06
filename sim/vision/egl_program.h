// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <GLES3/gl3.h>

#include <glm/vec2.hpp>
#include <memory>

#include "sim/scene/texture.h"
#include "sim/vision/camera_sensor.h"

namespace earshot {

/// Surfaces nearer to the eye than this are not drawn.
inline constexpr float kNearPlaneM = 0.01f;

/// What a pixel of the target holds: x bits of the depth in metres along the view axis (0: nothing), y encoded sRGB (r | g << 8 | b << 16),
/// z number of the triangle, w nothing.
struct PixelWord {
  std::uint32_t depth_bits, rgb, triangle, unused;
};

/// The shaders: the pinhole of camera_sensor.h, the light of light_on, the texture sampling of sample_bilinear.
class EglProgram {
 public:
  /// Attributes of a vertex, by location.
  enum Attribute : GLuint { position = 0, normal = 1, color = 2, uv = 3, triangle = 4 };

  /// Throws RunError with the driver's log if a shader does not compile.
  EglProgram();
  ~EglProgram();
  EglProgram(const EglProgram&) = delete;
  EglProgram& operator=(const EglProgram&) = delete;

  void use() const;
  void set_camera(const CameraSensorConfig& config, const CameraFrame& frame) const;
  /// texture: bound to unit 0; null: none.
  void set_texture(const Texture* texture) const;

 private:
  struct Uniforms;
  GLuint program_ = 0;
  std::unique_ptr<Uniforms> uniforms_;
};

}  // namespace earshot
