// SPDX-License-Identifier: Apache-2.0
#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <charconv>
#include <cmath>
#include <memory>
#include <nlohmann/json.hpp>
#include <numbers>
#include <optional>
#include <string>
#include <tuple>
#include <vector>

#include "apps/commands.h"
#include "apps/options/output_options.h"
#include "apps/options/parse_point.h"
#include "apps/options/picture_size.h"
#include "apps/options/print_warning.h"
#include "apps/options/scene_options.h"
#include "sim/base/coordinates.h"
#include "sim/base/errors.h"
#include "sim/base/files.h"
#include "sim/base/text/json.h"
#include "sim/scene/appearance.h"
#include "sim/scene/category_palette.h"
#include "sim/scene/checks/scene_check.h"
#include "sim/vision/egl_renderer.h"
#include "sim/vision/embree_camera.h"
#include "sim/vision/png_file.h"

namespace earshot {
namespace {

struct RenderArguments {
  SceneOptions scene;
  std::string pose, sensor = "rgb", size = "512x512", renderer = "embree", device = "auto", out, json;
  double fov_deg = 90, height_m = 1.25, yaw_deg = 0, pitch_deg = 0, max_depth_m = 10;
  bool panorama = false, unlit = false;
};

/// "X,Y,Z,HEADING": the position in the coordinates of the file, the heading in degrees.
Pose parse_pose(const std::string& text, const Scene& scene) {
  const std::size_t last = text.rfind(',');
  double heading_deg = 0;
  const char* end = text.data() + text.size();
  const auto parsed = last == std::string::npos ? std::from_chars_result{text.data(), std::errc::invalid_argument}
                                                : std::from_chars(text.data() + last + 1, end, heading_deg);
  if (std::count(text.begin(), text.end(), ',') != 3 || parsed.ec != std::errc() || parsed.ptr != end || !(std::fabs(heading_deg) <= 1e6))
    throw InputError("--pose " + text, "is not a pose",
                     "write X,Y,Z,HEADING, the foot point in metres and the heading in degrees, for example 1.2,0,0.8,90");
  return {.position = scene.to_local(parse_point(text.substr(0, last), "--pose")), .heading_rad = heading_deg * std::numbers::pi / 180.0};
}

CameraSensorConfig camera_of(const RenderArguments& options) {
  CameraSensorConfig config{.projection = options.panorama ? Projection::equirectangular : Projection::pinhole,
                            .horizontal_fov_deg = static_cast<float>(options.panorama ? 360 : options.fov_deg),
                            .up_m = static_cast<float>(options.height_m),
                            .yaw_deg = static_cast<float>(options.yaw_deg),
                            .pitch_deg = static_cast<float>(options.pitch_deg),
                            .max_depth_m = static_cast<float>(options.max_depth_m),
                            .unlit = options.unlit};
  std::tie(config.width_px, config.height_px) = parse_picture_size(options.size, "512x384");
  validate(config);
  return config;
}

/// The categories in the picture, each with its fraction of the pixels.
void write_legend(const std::vector<std::uint16_t>& semantic, const std::string& json_file) {
  std::vector<std::size_t> count(category_names().size(), 0);
  for (const std::uint16_t number : semantic) ++count[number];
  nlohmann::ordered_json rows = nlohmann::ordered_json::array();
  for (std::size_t i = 0; i < count.size(); ++i) {
    if (count[i] == 0) continue;
    const double fraction = static_cast<double>(count[i]) / static_cast<double>(semantic.size());
    fmt::print("{:4}  {:<20} {:5.1f} %\n", i, category_names()[i], 100.0 * fraction);
    rows.push_back({{"category", i}, {"name", category_names()[i]}, {"fraction", fraction}});
  }
  const nlohmann::ordered_json report{{"schema_version", 1}, {"categories", std::move(rows)}};
  if (!json_file.empty()) write_file_atomically(json_file, json_text(report, 2) + "\n");
}

void run_render(const RenderArguments& options) {
  if (!options.json.empty() && options.sensor != "semantic")
    throw InputError("--json", "has no effect on this sensor, which has no table of categories", "use --sensor semantic, or leave it out");
  const CameraSensorConfig config = camera_of(options);
  const SceneOverrides overrides = options.scene.overrides();
  const auto shared_scene = std::make_shared<const Scene>(load_scene(options.scene.scene, overrides));
  const Scene& scene = *shared_scene;
  const Pose pose = parse_pose(options.pose, scene);
  for (const std::string& warning : scene_warnings(scene)) print_warning(warning);
  const auto pixels = static_cast<std::size_t>(config.width_px) * static_cast<std::size_t>(config.height_px);
  std::shared_ptr<const Appearance> appearance;
  if (options.sensor == "rgb" || options.sensor == "semantic") appearance = load_appearance(scene, overrides);
  if (appearance)
    for (const std::string& warning : appearance->warnings) print_warning(warning);
  const auto render = [&](const CameraImages& images) {
    if (options.renderer == "embree") return EmbreeCamera(config).render(scene, appearance.get(), pose, images);
    const EglView view{shared_scene, appearance, pose, images};
    EglRenderer renderer({.device = options.device});
    renderer.render(config, {&view, 1});
    fmt::print("drawn by {}\n", renderer.device_name());
  };

  if (options.sensor == "depth") {
    std::vector<float> depth(pixels);
    render({.depth = depth});
    write_png_grey16(options.out, config.width_px, config.height_px, depth);
    const auto [nearest, farthest] = std::minmax_element(depth.begin(), depth.end());
    fmt::print("depth {:.3f} to {:.3f} m; white is {} m and beyond\n", *nearest * config.max_depth_m, *farthest * config.max_depth_m,
               config.max_depth_m);
  } else if (options.sensor == "rgb") {
    std::vector<std::uint8_t> rgb(3 * pixels);
    render({.rgb = rgb});
    write_png_rgb(options.out, config.width_px, config.height_px, rgb);
  } else if (options.sensor == "semantic") {
    std::vector<std::uint16_t> semantic(pixels);
    render({.semantic = semantic});
    write_png_indexed(options.out, config.width_px, config.height_px, semantic, category_palette());
    write_legend(semantic, options.json);
  } else {
    std::vector<float> normals(3 * pixels);
    render({.normals = normals});
    std::vector<std::uint8_t> rgb(3 * pixels);
    std::transform(normals.begin(), normals.end(), rgb.begin(),
                   [](float value) { return static_cast<std::uint8_t>(std::lround(127.5f + 127.5f * std::clamp(value, -1.f, 1.f))); });
    write_png_rgb(options.out, config.width_px, config.height_px, rgb);
  }
}

}  // namespace

void add_render(CLI::App& app) {
  const auto options = std::make_shared<RenderArguments>();
  CLI::App* command = app.add_subcommand("render", "Render the view of an agent's camera to a PNG file");
  options->scene.add_to(*command);
  command
      ->add_option("--pose", options->pose, "X,Y,Z,HEADING: the agent's foot point in metres, and its heading in degrees to the left of -z")
      ->required();
  command->add_option("--out", options->out, "PNG file to write")->type_name(kOutputFile)->required();
  command
      ->add_option(
          "--sensor", options->sensor,
          "Sensor: depth (16-bit gray), rgb, semantic (palette image whose indices are categories) or normals (camera axes; 128 means 0)")
      ->check(CLI::IsMember({"depth", "rgb", "semantic", "normals"}))
      ->capture_default_str();
  command->add_option("--renderer", options->renderer, "Renderer: embree (ray tracing on the CPU) or egl (OpenGL ES, no display needed)")
      ->check(CLI::IsMember({"embree", "egl"}))
      ->capture_default_str();
  command
      ->add_option("--device", options->device,
                   "Device of egl: auto (GPU only), software (Mesa on the CPU), a number from 'earshot doctor', a UUID, or cuda:N")
      ->capture_default_str();
  command->add_option("--size", options->size, "Image size as WIDTHxHEIGHT in pixels")->capture_default_str();
  command->add_option("--fov", options->fov_deg, "Horizontal field of view in degrees")->capture_default_str();
  command->add_option("--height", options->height_m, "Height of the camera above the foot point in metres")->capture_default_str();
  command->add_option("--yaw", options->yaw_deg, "Yaw of the camera in degrees, positive is left of the heading")->capture_default_str();
  command->add_option("--pitch", options->pitch_deg, "Pitch of the camera in degrees, positive is up")->capture_default_str();
  command->add_option("--max-depth", options->max_depth_m, "Depth in metres that is drawn white")->capture_default_str();
  command->add_flag("--panorama", options->panorama,
                    "Panorama: the width spans 360 degrees, rows are angles (height at most half the width)");
  command->add_option("--json", options->json, "With --sensor semantic: also write the table of categories to this JSON file")
      ->type_name(kOutputFile);
  command->add_flag("--unlit", options->unlit, "Plain material colors without shading");
  command->callback([options] { run_render(*options); });
}

}  // namespace earshot
