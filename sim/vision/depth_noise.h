// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <span>
#include <vector>

#include "sim/vision/camera_sensor.h"

namespace earshot {

class ConfigReader;

/// Noise of a structured-light depth camera (PrimeSense, Kinect): what it matches is a shift of a pattern in pixels, so that noise grows
/// with the square of the distance.  The model of the Redwood data set (Choi, Zhou and Koltun 2015, "Robust reconstruction of indoor
/// scenes", after Barron and Malik 2013) without its table of lens distortion, which is one device's own:
///
///   z' = f b / (round(8 (f b / z(p') + n)) / 8),   p' = p + (n_x, n_y) rounded to whole pixels
///
/// with f b = 35.13 pixels x metres, n ~ N(0, disparity_px), n_x, n_y ~ N(0, jitter_px): at 3 m a standard deviation of 12 mm, 7 mm from n
/// and 9 mm from the steps of an eighth of a pixel.
struct DepthNoiseConfig {
  float disparity_px = 0.027778f;  ///< standard deviation of the matched shift, [0, 1]
  float jitter_px = 0.25f;         ///< standard deviation of where an edge appears, [0, 4]
  float quantum_px = 0.125f;       ///< step of the shift, 0: none, [0, 1]
};
/// Reads the fields by their names over `config`.  Throws InputError.
void read(ConfigReader& reader, DepthNoiseConfig& config);
/// Throws InputError naming key, value and what is allowed.
void validate(const DepthNoiseConfig& config);

/// Which numbers the noise takes: the same place, the same bits, whatever the thread or the batch.
struct DepthNoiseDraw {
  std::uint64_t seed = 0;
  std::uint32_t env = 0, episode = 0, step = 0;  ///< step: below 2^24
};

/// clean, noisy: [height, width] of `camera`, in [0, 1] of its max_depth_m, not the same memory.  What is at 1 (nothing within reach) stays
/// 1, what noise moves past the ends is clipped.  About 60 ns per pixel, no allocation, safe from any thread.
void add_depth_noise(const DepthNoiseConfig& config, const CameraSensorConfig& camera, const DepthNoiseDraw& draw,
                     std::span<const float> clean, std::span<float> noisy);

}  // namespace earshot
