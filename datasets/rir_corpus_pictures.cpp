// SPDX-License-Identifier: Apache-2.0
#include "datasets/rir_corpus_pictures.h"

#include "sim/scene/category_palette.h"
#include "sim/vision/png_file.h"

namespace earshot {
namespace {

/// So that 16 bits of a picture are millimetres.
constexpr float kMaxDepthM = 65.535f;

CameraSensorConfig camera_of(const CorpusPanorama& config) {
  return {.width_px = config.width_px,
          .height_px = config.height_px,
          .projection = Projection::equirectangular,
          .horizontal_fov_deg = 360,
          .up_m = 0,
          .max_depth_m = kMaxDepthM};
}

}  // namespace

CorpusPictures::CorpusPictures(const CorpusPanorama& config, const Scene& scene)
    : camera_(camera_of(config)), appearance_(load_appearance(scene)) {}

std::vector<CorpusFile> CorpusPictures::render(const Scene& scene, glm::vec3 position, double heading_rad, const std::string& id) const {
  const int width = camera_.config().width_px, height = camera_.config().height_px;
  const auto pixels = static_cast<std::size_t>(width) * static_cast<std::size_t>(height);
  std::vector<float> depth(pixels);
  std::vector<std::uint8_t> rgb(3 * pixels);
  std::vector<std::uint16_t> categories(pixels);
  camera_.render(scene, appearance_.get(), Pose{position, heading_rad}, {.depth = depth, .rgb = rgb, .semantic = categories});
  return {{id + ".rgb.png", encode_png_rgb(id, width, height, rgb)},
          {id + ".depth.png", encode_png_grey16(id, width, height, depth)},
          {id + ".category.png", encode_png_indexed(id, width, height, categories, category_palette())}};
}

}  // namespace earshot
