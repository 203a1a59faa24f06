// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <array>
#include <cstdint>
#include <glm/vec2.hpp>
#include <string_view>

#include "sim/scene/texture.h"

namespace earshot {

/// Whether these are the first bytes of a PNG or a JPEG.
bool is_texture(std::string_view bytes);

/// The bytes of the texel that (u, v) lies on, for pictures whose colours are numbers.  u, v finite.
std::array<std::uint8_t, 3> nearest_texel(const Texture& texture, glm::vec2 uv);

}  // namespace earshot
