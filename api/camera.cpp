// SPDX-License-Identifier: Apache-2.0
#include "earshot/camera.h"

#include <cmath>
#include <numbers>

#include "api/convert.h"
#include "api/scene_model.h"
#include "sim/base/errors.h"
#include "sim/vision/embree_camera.h"
#include "sim/vision/png_file.h"

namespace earshot::api {
namespace {

CameraSensorConfig sensor_config(const CameraOptions& options) {
  return {.width_px = options.width_px,
          .height_px = options.height_px,
          .projection = options.panorama ? Projection::equirectangular : Projection::pinhole,
          .horizontal_fov_deg = static_cast<float>(options.fov_deg),
          .up_m = static_cast<float>(options.height_m),
          .yaw_deg = static_cast<float>(options.yaw_deg),
          .pitch_deg = static_cast<float>(options.pitch_deg),
          .max_depth_m = static_cast<float>(options.max_depth_m),
          .unlit = options.unlit};
}

}  // namespace

struct Camera::Model {
  std::shared_ptr<Scene::Model> scene;
  EmbreeCamera camera;
};

Camera::Camera(const Scene& scene, const CameraOptions& options)
    : options_(options), model_(std::make_shared<Model>(Model{scene.model(), EmbreeCamera(sensor_config(options))})) {}

Pictures Camera::render(const Vec3& foot, double heading_deg, const PictureKinds& kinds) const {
  require_finite(foot, "foot");
  require(std::isfinite(heading_deg), "heading_deg", heading_deg, "must be finite");
  const auto pixels = static_cast<std::size_t>(options_.width_px) * static_cast<std::size_t>(options_.height_px);
  Pictures pictures;
  pictures.width_px = options_.width_px;
  pictures.height_px = options_.height_px;
  if (kinds.depth) pictures.depth.resize(pixels);
  if (kinds.rgb) pictures.rgb.resize(3 * pixels);
  if (kinds.semantic) pictures.semantic.resize(pixels);
  if (kinds.normals) pictures.normals.resize(3 * pixels);
  const std::shared_ptr<const Appearance> appearance = kinds.rgb || kinds.semantic ? model_->scene->appearance() : nullptr;
  const earshot::Scene& scene = model_->scene->scene();
  const Pose pose{.position = scene.to_local(glm_of(foot)), .heading_rad = heading_deg * std::numbers::pi / 180};
  model_->camera.render(scene, appearance.get(), pose,
                        {.depth = pictures.depth, .rgb = pictures.rgb, .semantic = pictures.semantic, .normals = pictures.normals});
  return pictures;
}

const std::vector<std::string>& semantic_categories() { return category_names(); }

void write_rgb_png(const std::filesystem::path& path, const Pictures& pictures) {
  if (pictures.rgb.empty()) throw InputError(path.string(), "has no colours to show", "render with PictureKinds::rgb");
  write_png_rgb(path, pictures.width_px, pictures.height_px, pictures.rgb);
}

void write_depth_png(const std::filesystem::path& path, const Pictures& pictures) {
  if (pictures.depth.empty()) throw InputError(path.string(), "has no depth to show", "render with PictureKinds::depth");
  write_png_grey16(path, pictures.width_px, pictures.height_px, pictures.depth);
}

}  // namespace earshot::api
