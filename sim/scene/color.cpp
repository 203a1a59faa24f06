// SPDX-License-Identifier: Apache-2.0
#include "sim/scene/color.h"

#include <algorithm>
#include <cmath>

namespace earshot {
namespace {

constexpr int kEncodeSteps = 8192;  // the steepest part of the curve covers 0.4 of an encoded value per step

}  // namespace

float decode_srgb(float encoded) { return encoded <= 0.04045f ? encoded / 12.92f : std::pow((encoded + 0.055f) / 1.055f, 2.4f); }

float encode_srgb(float linear) { return linear <= 0.0031308f ? 12.92f * linear : 1.055f * std::pow(linear, 1.f / 2.4f) - 0.055f; }

const std::array<float, 256>& srgb_values() {
  static const std::array<float, 256> values = [] {
    std::array<float, 256> filled{};
    for (std::size_t i = 0; i < filled.size(); ++i) filled[i] = decode_srgb(static_cast<float>(i) / 255.f);
    return filled;
  }();
  return values;
}

std::array<std::uint8_t, 3> to_srgb8(glm::vec3 linear) {
  static const std::array<std::uint8_t, kEncodeSteps + 1> encoded = [] {
    std::array<std::uint8_t, kEncodeSteps + 1> filled{};
    for (std::size_t i = 0; i < filled.size(); ++i)
      filled[i] = static_cast<std::uint8_t>(std::lround(255.f * encode_srgb(static_cast<float>(i) / kEncodeSteps)));
    return filled;
  }();
  std::array<std::uint8_t, 3> result{};
  for (int channel = 0; channel < 3; ++channel) {
    // Written so that NaN becomes 0.
    const float value = (linear[channel] > 0.f ? std::min(linear[channel], 1.f) : 0.f) * kEncodeSteps + 0.5f;
    result[static_cast<std::size_t>(channel)] = encoded[static_cast<std::size_t>(value)];
  }
  return result;
}

}  // namespace earshot
