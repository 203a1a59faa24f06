// SPDX-License-Identifier: Apache-2.0
#include "datasets/rir_corpus_pictures.h"

#include <algorithm>

#include "sim/scene/category_palette.h"
#include "sim/vision/png_file.h"

namespace earshot {
namespace {

/// So that 16 bits of a picture are millimetres.
constexpr float kMaxDepthM = 65.535f;

std::vector<EmbreeCamera> cameras_of(const CorpusPanorama& config) {
  CameraSensorConfig sensor{.width_px = config.width_px,
                            .height_px = config.height_px,
                            .projection = Projection::equirectangular,
                            .horizontal_fov_deg = 360,
                            .up_m = 0,
                            .max_depth_m = kMaxDepthM};
  std::vector<EmbreeCamera> cameras;
  if (config.views == 0) {
    cameras.emplace_back(sensor);
    return cameras;
  }
  sensor.projection = Projection::pinhole;
  sensor.width_px = config.width_px / config.views;
  sensor.horizontal_fov_deg = 360.f / static_cast<float>(config.views);
  for (int view = 0; view < config.views; ++view) {
    sensor.yaw_deg = 180.f - (static_cast<float>(view) + 0.5f) * sensor.horizontal_fov_deg;
    cameras.emplace_back(sensor);
  }
  return cameras;
}

}  // namespace

CorpusPictures::CorpusPictures(const CorpusPanorama& config, const Scene& scene)
    : cameras_(cameras_of(config)), width_px_(config.width_px), height_px_(config.height_px), appearance_(load_appearance(scene)) {}

std::vector<CorpusFile> CorpusPictures::render(const Scene& scene, glm::vec3 position, double heading_rad, const std::string& id) const {
  const auto width = static_cast<std::size_t>(width_px_), rows = static_cast<std::size_t>(height_px_);
  const std::size_t columns = width / cameras_.size(), pixels = width * rows;
  std::vector<float> depth(pixels), view_depth(columns * rows);
  std::vector<std::uint8_t> rgb(3 * pixels), view_rgb(3 * columns * rows);
  std::vector<std::uint16_t> categories(pixels), view_categories(columns * rows);
  for (std::size_t view = 0; view < cameras_.size(); ++view) {
    cameras_[view].render(scene, appearance_.get(), Pose{position, heading_rad},
                          {.depth = view_depth, .rgb = view_rgb, .semantic = view_categories});
    for (std::size_t row = 0; row < rows; ++row) {
      const std::size_t to = row * width + view * columns, from = row * columns;
      std::copy_n(&view_depth[from], columns, &depth[to]);
      std::copy_n(&view_rgb[3 * from], 3 * columns, &rgb[3 * to]);
      std::copy_n(&view_categories[from], columns, &categories[to]);
    }
  }
  return {{id + ".rgb.png", encode_png_rgb(id, width_px_, height_px_, rgb)},
          {id + ".depth.png", encode_png_grey16(id, width_px_, height_px_, depth)},
          {id + ".category.png", encode_png_indexed(id, width_px_, height_px_, categories, category_palette())}};
}

}  // namespace earshot
