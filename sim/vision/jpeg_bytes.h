// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <span>
#include <string>

namespace earshot {

/// A picture as the bytes of a JPEG file: small, for pages that people look at; an agent's pictures are never compressed.  pixels:
/// row-major [height, width, 3] encoded sRGB, or [height, width] grey where there are a third as many.  quality: 1 to 100; below 90 colours
/// have half the resolution.  Throws RunError if libturbojpeg cannot.  About 1 ms for 320 x 240.
std::string jpeg_bytes(int width_px, int height_px, std::span<const std::uint8_t> pixels, int quality);

}  // namespace earshot
