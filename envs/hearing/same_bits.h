// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <array>
#include <bit>
#include <cstdint>
#include <glm/vec3.hpp>

namespace earshot {

/// Unlike ==, distinguishes 0 from -0: results computed from equal bits have equal bits.
inline bool same_bits(glm::vec3 a, glm::vec3 b) {
  return std::bit_cast<std::array<std::uint32_t, 3>>(a) == std::bit_cast<std::array<std::uint32_t, 3>>(b);
}

}  // namespace earshot
