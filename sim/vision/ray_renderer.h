#pragma once

#include <glm/vec3.hpp>
#include <span>
#include <vector>

#include "sim/scene/scene.h"
#include "sim/vision/camera.h"

namespace earshot {

/// Depth images by ray casting, eight rays at a time.  Immutable, safe from any thread.
class RayRenderer {
 public:
  /// Throws InputError if the config is out of range.
  explicit RayRenderer(const CameraConfig& config);
  /// depth: [height, width] float, z distance along the view axis (not ray length) divided by max_depth_m, clipped to [0, 1]; 1 where
  /// nothing is hit.  About 1.5 ms for 128 x 128 in 200,000 triangles; no allocation.
  void render_depth(const Scene& scene, const Pose& pose, std::span<float> depth) const;
  [[nodiscard]] const CameraConfig& config() const { return config_; }

 private:
  CameraConfig config_;
  std::vector<glm::vec3> directions_;  ///< [height * width] unit: x to the right, y up, z along the view axis
};

}  // namespace earshot
