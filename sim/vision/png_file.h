// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <filesystem>
#include <span>
#include <string>

namespace earshot {

/// Pictures as PNG files, written whole or not at all.  All throw RunError if the file cannot be written.  pixels: row-major [height,
/// width, ...].

/// [height, width, 3] encoded sRGB.
void write_png_rgb(const std::filesystem::path& path, int width_px, int height_px, std::span<const std::uint8_t> rgb);
/// [height, width] in [0, 1], as 16 bits of grey, linear (65535 is 1).
void write_png_grey16(const std::filesystem::path& path, int width_px, int height_px, std::span<const float> grey);
/// [height, width] numbers below 256 as a palette image: the indices are the numbers, palette [numbers, 3] is what they look like.
void write_png_indexed(const std::filesystem::path& path, int width_px, int height_px, std::span<const std::uint16_t> numbers,
                       std::span<const std::uint8_t> palette);

/// The same as bytes; where: how messages name them.
std::string encode_png_rgb(const std::string& where, int width_px, int height_px, std::span<const std::uint8_t> rgb);
std::string encode_png_grey16(const std::string& where, int width_px, int height_px, std::span<const float> grey);
std::string encode_png_indexed(const std::string& where, int width_px, int height_px, std::span<const std::uint16_t> numbers,
                               std::span<const std::uint8_t> palette);

}  // namespace earshot
