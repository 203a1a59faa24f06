#include "envs/sensors/observation.h"

#include <algorithm>
#include <set>

#include "envs/sensors/sensor.h"
#include "sim/base/errors.h"

namespace earshot {
namespace {

void read(ConfigReader& reader, ExtraCamera& camera) {
  reader.read("depth", camera.depth);
  reader.read("rgb", camera.rgb);
  reader.read("semantic", camera.semantic);
  reader.read("normals", camera.normals);
  CameraSensorConfig& config = camera.config;
  reader.read("width_px", config.width_px);
  reader.read("height_px", config.height_px);
  reader.read_choice<Projection>("projection", config.projection,
                                 {{"pinhole", Projection::pinhole}, {"equirectangular", Projection::equirectangular}});
  reader.read("horizontal_fov_deg", config.horizontal_fov_deg);
  reader.read("right_m", config.right_m);
  reader.read("up_m", config.up_m);
  reader.read("forward_m", config.forward_m);
  reader.read("yaw_deg", config.yaw_deg);
  reader.read("pitch_deg", config.pitch_deg);
  reader.read("max_depth_m", config.max_depth_m);
  reader.read("unlit", config.unlit);
}

}  // namespace

std::vector<ExtraCamera> ObservationSpec::all_cameras() const {
  std::vector<ExtraCamera> all;
  if (depth || rgb || semantic || normals) {
    all.push_back({.name = "", .config = sensor_of(camera), .depth = depth, .rgb = rgb, .semantic = semantic, .normals = normals});
    all.back().config.unlit = unlit;
  }
  all.insert(all.end(), cameras.begin(), cameras.end());
  return all;
}

void read(ConfigReader& reader, ObservationSpec& spec) {
  reader.read("depth", spec.depth);
  reader.read("rgb", spec.rgb);
  reader.read("semantic", spec.semantic);
  reader.read("normals", spec.normals);
  reader.read("unlit", spec.unlit);
  reader.read_choice<Renderer>("renderer", spec.renderer,
                               {{"embree", Renderer::embree}, {"egl", Renderer::egl}, {"auto", Renderer::automatic}});
  reader.read("egl_device", spec.egl_device);
  reader.read("spectrogram", spec.spectrogram);
  reader.read("interaural", spec.interaural);
  reader.read("waveform", spec.waveform);
  reader.read("heard", spec.heard);
  reader.read("pointgoal", spec.pointgoal);
  reader.read("gps_compass", spec.gps_compass);
  reader.read("pose", spec.pose);
  reader.read("collision", spec.collision);
  reader.read("previous_action", spec.previous_action);
  reader.read("topdown_map", spec.topdown_map);
  reader.read("oracle_action", spec.oracle_action);
  reader.read("goal_state", spec.goal_state);
  reader.read("legacy_spectrogram", spec.legacy_spectrogram);
  ConfigReader camera = reader.child("camera");
  camera.read("width_px", spec.camera.width_px);
  camera.read("height_px", spec.camera.height_px);
  camera.read("horizontal_fov_deg", spec.camera.horizontal_fov_deg);
  camera.read("height_m", spec.camera.height_m);
  camera.read("max_depth_m", spec.camera.max_depth_m);
  camera.finish();
  ConfigReader cameras = reader.child("cameras");
  for (const std::string& name : cameras.keys()) {
    const auto known = std::find_if(spec.cameras.begin(), spec.cameras.end(), [&](const auto& other) { return other.name == name; });
    if (known == spec.cameras.end()) spec.cameras.push_back({.name = name});
  }
  for (ExtraCamera& further : spec.cameras) {
    ConfigReader keys = cameras.child(further.name);
    read(keys, further);
    keys.finish();
  }
  cameras.finish();
  reader.read("depth_noise", spec.depth_noise);
  ConfigReader noise = reader.child("noise");
  noise.read("disparity_px", spec.noise.disparity_px);
  noise.read("jitter_px", spec.noise.jitter_px);
  noise.read("quantum_px", spec.noise.quantum_px);
  noise.read("position_m", spec.pose_noise.position_m);
  noise.read("heading_deg", spec.pose_noise.heading_deg);
  noise.finish();
  ConfigReader map = reader.child("map");
  map.read("size_px", spec.map.size_px);
  map.read("metres_per_px", spec.map.metres_per_px);
  map.read_choice<MapFrame>("frame", spec.map.frame, {{"egocentric", MapFrame::egocentric}, {"allocentric", MapFrame::allocentric}});
  map.read("goal", spec.map.goal);
  map.finish();
}

void validate(const ObservationSpec& spec) {
  require(!sensor_table(spec, 1).empty(), "observation", "(empty)", "must have at least one sensor: the policy needs an input");
  require(spec.spectrogram || !spec.legacy_spectrogram, "observation.legacy_spectrogram", true,
          "has no effect without observation.spectrogram");
  validate(spec.camera);
  validate(spec.noise);
  validate(spec.map);
  const TopdownMapConfig untouched;
  const auto require_map = [&](bool as_it_was, const char* key, const auto& value) {
    require(spec.topdown_map || as_it_was, key, value, "has no effect without observation.topdown_map");
  };
  require_map(spec.map.size_px == untouched.size_px, "observation.map.size_px", spec.map.size_px);
  require_map(spec.map.metres_per_px == untouched.metres_per_px, "observation.map.metres_per_px", spec.map.metres_per_px);
  require_map(spec.map.frame == untouched.frame, "observation.map.frame", "allocentric");
  require_map(spec.map.goal == untouched.goal, "observation.map.goal", true);
  const PoseNoiseConfig& pose_noise = spec.pose_noise;
  require(pose_noise.position_m >= 0.f && pose_noise.position_m <= 10.f, "observation.noise.position_m", pose_noise.position_m,
          "must be in [0, 10] metres");
  require(pose_noise.heading_deg >= 0.f && pose_noise.heading_deg <= 180.f, "observation.noise.heading_deg", pose_noise.heading_deg,
          "must be in [0, 180] degrees");
  require(spec.gps_compass || spec.pose || !pose_noise.any(), "observation.noise.position_m", pose_noise.position_m,
          "has no effect without gps_compass or pose; the same holds for heading_deg");
  std::set<std::string> names;
  bool any_depth = spec.depth;
  for (const ExtraCamera& camera : spec.cameras) {
    require(!camera.name.empty() && camera.name.find_first_not_of("abcdefghijklmnopqrstuvwxyz0123456789_") == std::string::npos,
            "observation.cameras.name", camera.name,
            "must contain only lower-case letters, digits and underscores: sensor names contain it");
    require(names.insert(camera.name).second, "observation.cameras.name", camera.name, "must be unique: sensor names contain it");
    require(camera.depth || camera.rgb || camera.semantic || camera.normals, "observation.cameras.name", camera.name,
            "has no sensor: set depth, rgb, semantic or normals to true");
    validate(camera.config);
    require(camera.rgb || !camera.config.unlit, "observation.cameras.unlit", true, "has no effect without rgb");
    any_depth = any_depth || camera.depth;
  }
  require(any_depth || !spec.depth_noise, "observation.depth_noise", true, "has no effect without a depth sensor");
  require(spec.rgb || !spec.unlit, "observation.unlit", true,
          "has no effect without observation.rgb; other cameras have their own key `unlit`");
  const std::vector<ExtraCamera> all = spec.all_cameras();
  const bool pinholes = std::ranges::any_of(all, [](const ExtraCamera& each) { return each.config.projection == Projection::pinhole; });
  require(spec.renderer != Renderer::egl || pinholes, "observation.renderer", "egl", "has no effect without a pinhole camera");
  require(spec.renderer != Renderer::embree || spec.egl_device == "auto", "observation.egl_device", spec.egl_device,
          "has no effect with renderer embree");
  require(spec.renderer != Renderer::automatic || spec.egl_device != "software", "observation.egl_device", spec.egl_device,
          "is never used by renderer auto; set observation.renderer to egl");
  const SpectrogramConfig& sound = spec.sound;
  require(sound.sample_rate_hz >= 8000.f && sound.sample_rate_hz <= 96000.f, "observation.sound.sample_rate_hz", sound.sample_rate_hz,
          "must be in [8000, 96000]");
  require(sound.num_samples >= sound.fft_size && sound.num_samples <= 10'000'000, "observation.sound.num_samples", sound.num_samples,
          "must be at least the length of one analysis frame");
}

}  // namespace earshot
