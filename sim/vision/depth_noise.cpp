// SPDX-License-Identifier: Apache-2.0
#include "sim/vision/depth_noise.h"

#include <algorithm>
#include <array>
#include <cmath>

#include "sim/base/errors.h"
#include "sim/base/random.h"
#include "sim/base/text/config_reader.h"

namespace earshot {
namespace {

constexpr float kShiftPxM = 35.13f;  ///< focal length times baseline of the device

}  // namespace

void read(ConfigReader& reader, DepthNoiseConfig& config) {
  reader.read("disparity_px", config.disparity_px, Allowed::between(0, 1), "Standard deviation of the matched shift of depth.");
  reader.read("jitter_px", config.jitter_px, Allowed::between(0, 4), "Standard deviation of the place of edges in depth.");
  reader.read("quantum_px", config.quantum_px, Allowed::between(0, 1), "Step of the matched shift of depth. 0: none.");
}

void validate(const DepthNoiseConfig& config) { check_values(config, "observation.noise"); }

void add_depth_noise(const DepthNoiseConfig& config, const CameraSensorConfig& camera, const DepthNoiseDraw& draw,
                     std::span<const float> clean, std::span<float> noisy) {
  const int width = camera.width_px, height = camera.height_px;
  EARSHOT_EXPECT(clean.size() == static_cast<std::size_t>(width) * static_cast<std::size_t>(height) && noisy.size() == clean.size());
  EARSHOT_EXPECT(clean.data() != noisy.data());
  const RandomStream random(draw.seed, Purpose::depth_noise, draw.env, draw.episode, draw.step);
  const auto moved = [&](int at, float normal, int size) {
    return std::clamp(at + static_cast<int>(std::lround(config.jitter_px * normal)), 0, size - 1);
  };
  std::uint32_t pixel = 0;
  for (int row = 0; row < height; ++row)
    for (int column = 0; column < width; ++column, ++pixel) {
      // Two draws of two normal numbers per pixel: place, then shift.
      const std::array<float, 2> place = random.normal2(2 * pixel);
      const int from_row = moved(row, place[1], height), from_column = moved(column, place[0], width);
      const float depth =
          clean[static_cast<std::size_t>(from_row) * static_cast<std::size_t>(width) + static_cast<std::size_t>(from_column)];
      if (!(depth > 0.f && depth < 1.f)) {
        noisy[pixel] = depth;
        continue;
      }
      float shift_px = kShiftPxM / (depth * camera.max_depth_m) + config.disparity_px * random.normal2(2 * pixel + 1)[0];
      if (config.quantum_px > 0.f) shift_px = config.quantum_px * std::round(shift_px / config.quantum_px);
      noisy[pixel] = shift_px > 0.f ? std::min(kShiftPxM / shift_px / camera.max_depth_m, 1.f) : 1.f;
    }
}

}  // namespace earshot
