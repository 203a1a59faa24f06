// SPDX-License-Identifier: Apache-2.0
#include "sim/scene/texture.h"

#include <fmt/format.h>
#include <png.h>
#include <turbojpeg.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <glm/common.hpp>
#include <memory>

#include "sim/base/errors.h"
#include "sim/scene/color.h"
#include "sim/scene/texel.h"

namespace earshot {
namespace {

/// Beyond this many repetitions a float has no texels left to tell apart, and an int no room.
constexpr float kFarthestUv = 65536.f;

constexpr int kLargestSide = 8192;  // rejects small files that expand to gigabytes

[[noreturn]] void refuse(const std::string& where, const std::string& problem) {
  throw InputError(where, problem, "export the texture again as PNG or JPEG");
}

void check_size(const std::string& where, std::uint64_t width, std::uint64_t height) {
  if (width > kLargestSide || height > kLargestSide)
    refuse(where, fmt::format("has {} x {} pixels, but at most {} per side are supported", width, height, kLargestSide));
}

Texture decode_png(std::string_view bytes, const std::string& where) {
  png_image image{};
  image.version = PNG_IMAGE_VERSION;
  const std::unique_ptr<png_image, decltype(&png_image_free)> release(&image, png_image_free);
  if (png_image_begin_read_from_memory(&image, bytes.data(), bytes.size()) == 0)
    refuse(where, fmt::format("is not a complete PNG: {}", image.message));
  check_size(where, image.width, image.height);
  // With the alpha channel read and dropped: without it libpng would blend with a background.
  image.format = PNG_FORMAT_RGBA;
  std::vector<std::uint8_t> rgba(PNG_IMAGE_SIZE(image));
  if (png_image_finish_read(&image, nullptr, rgba.data(), 0, nullptr) == 0)
    refuse(where, fmt::format("is not a complete PNG: {}", image.message));
  Texture texture{.width_px = static_cast<int>(image.width), .height_px = static_cast<int>(image.height)};
  texture.rgb.reserve(rgba.size() / 4 * 3);
  for (std::size_t i = 0; i < rgba.size(); i += 4) texture.rgb.insert(texture.rgb.end(), {rgba[i], rgba[i + 1], rgba[i + 2]});
  return texture;
}

Texture decode_jpeg(std::string_view bytes, const std::string& where) {
  const std::unique_ptr<void, decltype(&tjDestroy)> reader(tjInitDecompress(), tjDestroy);
  if (!reader) refuse(where, "cannot be read: libjpeg-turbo failed to initialize");
  const auto* data = reinterpret_cast<const unsigned char*>(bytes.data());
  int width = 0, height = 0, subsampling = 0, colorspace = 0;
  if (tjDecompressHeader3(reader.get(), data, bytes.size(), &width, &height, &subsampling, &colorspace) != 0)
    refuse(where, fmt::format("is not a complete JPEG: {}", tjGetErrorStr2(reader.get())));
  if (width <= 0 || height <= 0) refuse(where, "is not a complete JPEG: it contains no image");
  check_size(where, static_cast<std::uint64_t>(width), static_cast<std::uint64_t>(height));
  Texture texture{.width_px = width, .height_px = height};
  texture.rgb.resize(3 * static_cast<std::size_t>(width) * static_cast<std::size_t>(height));
  if (tjDecompress2(reader.get(), data, bytes.size(), texture.rgb.data(), width, 0, height, TJPF_RGB, TJFLAG_ACCURATEDCT) != 0)
    refuse(where, fmt::format("is not a complete JPEG: {}", tjGetErrorStr2(reader.get())));
  return texture;
}

/// Half the size, rounded up; each texel the mean of its up to four, in linear light.
Texture halved(const Texture& whole) {
  Texture half{.width_px = (whole.width_px + 1) / 2, .height_px = (whole.height_px + 1) / 2};
  half.rgb.reserve(3 * static_cast<std::size_t>(half.width_px) * static_cast<std::size_t>(half.height_px));
  const std::array<float, 256>& linear = srgb_values();
  const auto texel = [&](int row, int column) {
    const std::size_t at = 3 * (static_cast<std::size_t>(std::min(row, whole.height_px - 1)) * static_cast<std::size_t>(whole.width_px) +
                                static_cast<std::size_t>(std::min(column, whole.width_px - 1)));
    return glm::vec3(linear[whole.rgb[at]], linear[whole.rgb[at + 1]], linear[whole.rgb[at + 2]]);
  };
  for (int row = 0; row < whole.height_px; row += 2)
    for (int column = 0; column < whole.width_px; column += 2) {
      const auto mean =
          to_srgb8(0.25f * (texel(row, column) + texel(row, column + 1) + texel(row + 1, column) + texel(row + 1, column + 1)));
      half.rgb.insert(half.rgb.end(), mean.begin(), mean.end());
    }
  return half;
}

int wrapped(int index, int size, TextureWrap wrap) {
  if (wrap == TextureWrap::clamp) return std::clamp(index, 0, size - 1);
  const int period = wrap == TextureWrap::mirror ? 2 * size : size;
  int inside = index % period;
  if (inside < 0) inside += period;
  return inside < size ? inside : period - 1 - inside;
}

}  // namespace

bool is_texture(std::string_view bytes) { return bytes.starts_with("\x89PNG") || bytes.starts_with("\xFF\xD8"); }

Texture decode_texture(std::string_view bytes, const std::string& where, int largest_px) {
  EARSHOT_EXPECT(largest_px > 0);
  Texture texture;
  if (bytes.starts_with("\x89PNG"))
    texture = decode_png(bytes, where);
  else if (bytes.starts_with("\xFF\xD8"))
    texture = decode_jpeg(bytes, where);
  else
    refuse(where, "is neither PNG nor JPEG");
  while (std::max(texture.width_px, texture.height_px) > largest_px) texture = halved(texture);
  return texture;
}

std::array<std::uint8_t, 3> nearest_texel(const Texture& texture, glm::vec2 uv) {
  const glm::vec2 at = glm::floor(glm::clamp(uv, -kFarthestUv, kFarthestUv) * glm::vec2(texture.width_px, texture.height_px));
  const int row = wrapped(static_cast<int>(at.y), texture.height_px, texture.wrap_v),
            column = wrapped(static_cast<int>(at.x), texture.width_px, texture.wrap_u);
  const std::size_t index =
      3 * (static_cast<std::size_t>(row) * static_cast<std::size_t>(texture.width_px) + static_cast<std::size_t>(column));
  return {texture.rgb[index], texture.rgb[index + 1], texture.rgb[index + 2]};
}

glm::vec3 sample_bilinear(const Texture& texture, glm::vec2 uv) {
  const std::array<float, 256>& linear = srgb_values();
  const glm::vec2 at = glm::clamp(uv, -kFarthestUv, kFarthestUv) * glm::vec2(texture.width_px, texture.height_px) - 0.5f;
  const glm::vec2 lower = glm::floor(at), weight = at - lower;
  const int column = static_cast<int>(lower.x), row = static_cast<int>(lower.y);
  const auto texel = [&](int r, int c) {
    const std::size_t index =
        3 * (static_cast<std::size_t>(wrapped(r, texture.height_px, texture.wrap_v)) * static_cast<std::size_t>(texture.width_px) +
             static_cast<std::size_t>(wrapped(c, texture.width_px, texture.wrap_u)));
    return glm::vec3(linear[texture.rgb[index]], linear[texture.rgb[index + 1]], linear[texture.rgb[index + 2]]);
  };
  return glm::mix(glm::mix(texel(row, column), texel(row, column + 1), weight.x),
                  glm::mix(texel(row + 1, column), texel(row + 1, column + 1), weight.x), weight.y);
}

}  // namespace earshot
