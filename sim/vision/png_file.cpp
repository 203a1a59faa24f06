// SPDX-License-Identifier: Apache-2.0
#include "sim/vision/png_file.h"

#include <png.h>

#include <algorithm>
#include <cmath>
#include <memory>
#include <string>
#include <vector>

#include "sim/base/errors.h"
#include "sim/base/files.h"

namespace earshot {
namespace {

std::string encode(const std::string& where, int width_px, int height_px, std::uint32_t format, const void* pixels, const void* palette,
                   std::uint32_t palette_size) {
  png_image image{};
  image.version = PNG_IMAGE_VERSION;
  image.width = static_cast<png_uint_32>(width_px);
  image.height = static_cast<png_uint_32>(height_px);
  image.format = format;
  image.colormap_entries = palette_size;
  const std::unique_ptr<png_image, decltype(&png_image_free)> release(&image, png_image_free);
  std::string bytes(PNG_IMAGE_PNG_SIZE_MAX(image), '\0');
  png_alloc_size_t size = bytes.size();
  if (png_image_write_to_memory(&image, bytes.data(), &size, 0, pixels, 0, palette) == 0)
    throw RunError(where, std::string("libpng cannot write it: ") + image.message);
  bytes.resize(size);
  return bytes;
}

}  // namespace

std::string encode_png_rgb(const std::string& where, int width_px, int height_px, std::span<const std::uint8_t> rgb) {
  EARSHOT_EXPECT(rgb.size() == 3 * static_cast<std::size_t>(width_px) * static_cast<std::size_t>(height_px));
  return encode(where, width_px, height_px, PNG_FORMAT_RGB, rgb.data(), nullptr, 0);
}

std::string encode_png_grey16(const std::string& where, int width_px, int height_px, std::span<const float> grey) {
  EARSHOT_EXPECT(grey.size() == static_cast<std::size_t>(width_px) * static_cast<std::size_t>(height_px));
  std::vector<std::uint16_t> values(grey.size());
  std::transform(grey.begin(), grey.end(), values.begin(),
                 [](float value) { return static_cast<std::uint16_t>(std::lround(65535.f * std::clamp(value, 0.f, 1.f))); });
  return encode(where, width_px, height_px, PNG_FORMAT_LINEAR_Y, values.data(), nullptr, 0);
}

std::string encode_png_indexed(const std::string& where, int width_px, int height_px, std::span<const std::uint16_t> numbers,
                               std::span<const std::uint8_t> palette) {
  EARSHOT_EXPECT(numbers.size() == static_cast<std::size_t>(width_px) * static_cast<std::size_t>(height_px));
  EARSHOT_EXPECT(palette.size() % 3 == 0 && palette.size() <= 3 * 256);
  std::vector<std::uint8_t> indices(numbers.size());
  std::transform(numbers.begin(), numbers.end(), indices.begin(), [&](std::uint16_t number) {
    EARSHOT_EXPECT(3u * number < palette.size());
    return static_cast<std::uint8_t>(number);
  });
  return encode(where, width_px, height_px, PNG_FORMAT_RGB_COLORMAP, indices.data(), palette.data(),
                static_cast<std::uint32_t>(palette.size() / 3));
}

void write_png_rgb(const std::filesystem::path& path, int width_px, int height_px, std::span<const std::uint8_t> rgb) {
  write_file_atomically(path, encode_png_rgb(path.string(), width_px, height_px, rgb));
}

void write_png_grey16(const std::filesystem::path& path, int width_px, int height_px, std::span<const float> grey) {
  write_file_atomically(path, encode_png_grey16(path.string(), width_px, height_px, grey));
}

void write_png_indexed(const std::filesystem::path& path, int width_px, int height_px, std::span<const std::uint16_t> numbers,
                       std::span<const std::uint8_t> palette) {
  write_file_atomically(path, encode_png_indexed(path.string(), width_px, height_px, numbers, palette));
}

}  // namespace earshot
