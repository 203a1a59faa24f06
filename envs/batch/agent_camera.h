// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstddef>
#include <span>
#include <vector>

#include "envs/batch/batch_rows.h"
#include "sim/vision/depth_noise.h"
#include "sim/vision/embree_camera.h"

namespace earshot {

/// A camera that every agent of a batch carries, and the rows that it fills; null: that sensor is off.
struct AgentCamera {
  EmbreeCamera camera;
  SensorRows *depth = nullptr, *rgb = nullptr, *semantic = nullptr, *normals = nullptr;

  [[nodiscard]] const CameraSensorConfig& config() const { return camera.config(); }
  [[nodiscard]] bool is_pinhole() const { return config().projection == Projection::pinhole; }
  /// The images of one row; last: of the observation in which its last episode ended.
  [[nodiscard]] CameraImages images_of(std::size_t row, bool last) const {
    CameraImages images;
    const auto take = [&]<class T>(SensorRows* sensor, std::span<T>& image) {
      if (sensor) image = last ? sensor->last_row<T>(row) : sensor->row<T>(row);
    };
    take(depth, images.depth);
    take(rgb, images.rgb);
    take(semantic, images.semantic);
    take(normals, images.normals);
    return images;
  }
};

/// The cameras of the sensors of `spec`, in the order of ObservationSpec::all_cameras().  rows: must outlive them.
inline std::vector<AgentCamera> make_cameras(const ObservationSpec& spec, const BatchRows& rows) {
  std::vector<AgentCamera> cameras;
  for (const ExtraCamera& camera : spec.all_cameras()) {
    const int index = static_cast<int>(cameras.size());
    cameras.push_back({.camera = EmbreeCamera(camera.config),
                       .depth = rows.of(SensorKind::depth, index),
                       .rgb = rows.of(SensorKind::rgb, index),
                       .semantic = rows.of(SensorKind::semantic, index),
                       .normals = rows.of(SensorKind::normals, index)});
  }
  return cameras;
}

/// The depth noise of one camera: each has draws that no other has.
inline DepthNoiseDraw noise_of_camera(DepthNoiseDraw draw, std::size_t camera) {
  draw.seed += std::uint64_t{camera} << 48;
  return draw;
}

}  // namespace earshot
