// SPDX-License-Identifier: Apache-2.0
#include "datasets/grid/grid_pictures.h"

#include <array>
#include <numbers>

#include "datasets/grid/array_files.h"

namespace earshot {
namespace {

constexpr std::size_t kGridHeadings = 4;

template <class Value>
std::string_view bytes_view(const std::vector<Value>& values) {
  return {reinterpret_cast<const char*>(values.data()), values.size() * sizeof(Value)};  // NOLINT: bytes of numbers
}

}  // namespace

GridPictures::GridPictures(const Scene& scene, const SceneOverrides& overrides, int width_px, int height_px)
    : scene_(scene),
      camera_(CameraSensorConfig{.width_px = width_px, .height_px = height_px}),
      appearance_(load_appearance(scene, overrides)) {}

std::vector<CorpusFile> GridPictures::render(glm::vec3 foot, const std::string& prefix) const {
  const auto width = static_cast<std::size_t>(camera_.config().width_px), height = static_cast<std::size_t>(camera_.config().height_px);
  const std::size_t pixels = width * height;
  std::vector<float> depth(kGridHeadings * pixels);
  std::vector<std::uint8_t> rgb(3 * kGridHeadings * pixels);
  for (std::size_t heading = 0; heading < kGridHeadings; ++heading)
    camera_.render(
        scene_, appearance_.get(), Pose{foot, static_cast<double>(heading) * std::numbers::pi / 2},
        {.depth = std::span(depth).subspan(heading * pixels, pixels), .rgb = std::span(rgb).subspan(3 * heading * pixels, 3 * pixels)});
  const std::array<std::size_t, 4> rgb_shape{kGridHeadings, height, width, 3}, depth_shape{kGridHeadings, height, width, 1};
  return {{prefix + ".rgb.npy", encode_npy(kUint8, rgb_shape, bytes_view(rgb))},
          {prefix + ".depth.npy", encode_npy(kFloat32, depth_shape, bytes_view(depth))}};
}

std::size_t GridPictures::bytes() const {
  constexpr std::size_t of_a_pixel = 3 + sizeof(float), heads = 256;
  return kGridHeadings * static_cast<std::size_t>(camera_.config().width_px) * static_cast<std::size_t>(camera_.config().height_px) *
             of_a_pixel +
         heads;
}

}  // namespace earshot
