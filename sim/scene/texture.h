// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <glm/vec2.hpp>
#include <glm/vec3.hpp>
#include <string>
#include <string_view>
#include <vector>

namespace earshot {

/// What a coordinate outside [0, 1] means.
enum class TextureWrap : std::uint8_t { repeat = 0, clamp = 1, mirror = 2 };

/// A picture that lies on triangles.  Row 0 is at v = 0, as in glTF.
struct Texture {
  int width_px = 0, height_px = 0;
  std::vector<std::uint8_t> rgb = {};  ///< [height, width, 3] encoded sRGB
  TextureWrap wrap_u = TextureWrap::repeat, wrap_v = TextureWrap::repeat;
};

/// Decodes a PNG or JPEG (told by its first bytes), then halves it by means of 2 x 2 until no side is over `largest_px`.  Transparency is
/// dropped.  Throws InputError naming `where`: neither of the two, damaged, over 8,192 pixels on a side.
Texture decode_texture(std::string_view bytes, const std::string& where, int largest_px);

/// Linear light at (u, v): bilinear between the four texel centres around it, of decoded values, without smaller copies (mipmaps).  Every
/// renderer uses this formula.  u, v finite.  No allocation.
glm::vec3 sample_bilinear(const Texture& texture, glm::vec2 uv);

}  // namespace earshot
