// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <span>
#include <vector>

#include "sim/scene/appearance.h"
#include "sim/scene/scene.h"
#include "sim/vision/agent_body.h"
#include "sim/vision/camera_sensor.h"

namespace earshot {

/// All camera sensors by ray casting on the CPU: one ray per pixel serves all that is wanted.
///
///   const EmbreeCamera camera(config);                                 // once per sensor
///   const auto appearance = load_appearance(scene);                    // once per scene, only for rgb and semantic
///   camera.render(scene, appearance.get(), pose, {.depth = ..., .rgb = ..., .semantic = ..., .normals = ...});
///
/// Immutable, safe from any thread.
class EmbreeCamera {
 public:
  /// Throws InputError if the config is out of range.
  explicit EmbreeCamera(const CameraSensorConfig& config);
  /// appearance: of this scene; needed for rgb and semantic, else it may be null.  Rays go sixteen at a time, in blocks of 4 x 4
  /// pixels; depth has the same bits whatever else is wanted.  Depth alone takes 0.7 to 1 ms for 128 x 128 in 200,000 triangles;
  /// docs/evidence/cameras.md has the times.  No allocation.
  /// bodies: drawn into the scene, by rays that meet them before it: lit as it is, of category agent_category().  Each costs about
  /// 10 us a picture of 128 x 128, and 50 ns a pixel that may show it.
  void render(const Scene& scene, const Appearance* appearance, const Pose& pose, const CameraImages& images,
              std::span<const AgentBody> bodies = {}) const;
  [[nodiscard]] const CameraSensorConfig& config() const { return config_; }

 private:
  void render_depth(const Scene& scene, const CameraFrame& frame, std::span<const AgentBody> bodies, std::span<float> depth) const;
  [[nodiscard]] Directions16 directions_of(std::size_t packet, const CameraFrame& frame) const;

  CameraSensorConfig config_;
  // Packets of sixteen pixels, [packet * 16 + lane]; the last one is filled up with the last pixel.
  std::vector<std::uint32_t> pixels_;
  std::vector<float> right_, up_, forward_;  ///< their directions (pixel_directions)
};

}  // namespace earshot
