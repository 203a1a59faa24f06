// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <bit>
#include <cstdint>

namespace earshot {

/// By its bits: with denormals flushed, comparisons take it for zero.
inline bool has_denormal_bits(float value) {
  const auto bits = std::bit_cast<std::uint32_t>(value);
  return (bits & 0x7F800000u) == 0 && (bits & 0x007FFFFFu) != 0;
}

}  // namespace earshot
