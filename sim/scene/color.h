// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <array>
#include <cstdint>
#include <glm/vec3.hpp>

namespace earshot {

/// IEC 61966-2-1: encoded sRGB in [0, 1] to linear light, and back.
float decode_srgb(float encoded);
float encode_srgb(float linear);

/// Linear light of the 256 encoded values.
const std::array<float, 256>& srgb_values();
/// Nearest encoded value of linear light, per channel, clamped to [0, 1] first.  From a table: off by at most one.  No allocation.
std::array<std::uint8_t, 3> to_srgb8(glm::vec3 linear);

}  // namespace earshot
