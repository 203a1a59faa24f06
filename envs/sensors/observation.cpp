// SPDX-License-Identifier: Apache-2.0
#include "envs/sensors/observation.h"

#include <fmt/format.h>

#include <algorithm>
#include <set>

#include "envs/sensors/sensor.h"
#include "sim/audio/head/layout_file.h"
#include "sim/base/errors.h"
#include "sim/base/text/config_reader.h"

namespace earshot {
namespace {

/// Of StreamConvolver.
constexpr int kMaxSoundChannels = 64;

void read(ConfigReader& reader, ExtraCamera& camera) {
  reader.read("depth", camera.depth, "Depth picture, [H, W, 1] floats of max_depth_m.");
  reader.read("rgb", camera.rgb, "Colour picture, [H, W, 3] bytes.");
  reader.read("semantic", camera.semantic, "Picture of the semantic category numbers, [H, W, 1].");
  reader.read("normals", camera.normals, "Picture of the surface normals, [H, W, 3] floats.");
  read(reader, camera.config);
}

void read_cameras(ConfigReader& reader, ObservationSpec& spec) {
  ConfigReader camera = reader.child("camera", "Main camera of the agent: level, ahead, a pinhole.");
  read(camera, spec.camera);
  camera.finish();
  ConfigReader cameras = reader.child("cameras", "Further cameras by name; their sensors are NAME_depth, NAME_rgb and so on.");
  for (const std::string& name : cameras.free_keys("NAME")) {
    const auto known = std::find_if(spec.cameras.begin(), spec.cameras.end(), [&](const auto& other) { return other.name == name; });
    if (known == spec.cameras.end()) spec.cameras.push_back({.name = name});
  }
  for (ExtraCamera& further : spec.cameras) {
    ConfigReader keys = cameras.child(further.name, "A further camera, with at least one of depth, rgb, semantic and normals.");
    read(keys, further);
    keys.finish();
  }
  cameras.finish();
}

void read_noise(ConfigReader& reader, ObservationSpec& spec) {
  reader.read("depth_noise", spec.depth_noise, "Depth of all cameras has the noise of a structured-light camera, set by noise.");
  ConfigReader noise = reader.child("noise", "Noise of depth and of pose sensors.");
  read(noise, spec.noise);
  noise.read("position_m", spec.pose_noise.position_m, Allowed::between(0, 10),
             "Standard deviation of the position in gps_compass and pose, along each axis.");
  noise.read("heading_deg", spec.pose_noise.heading_deg, Allowed::between(0, 180),
             "Standard deviation of the heading in gps_compass and pose.");
  noise.finish();
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
  reader.read("depth", spec.depth, "Depth picture of the main camera.");
  reader.read("rgb", spec.rgb, "Colour picture of the main camera.");
  reader.read("semantic", spec.semantic, "Picture of semantic category numbers of the main camera.");
  reader.read("normals", spec.normals, "Picture of surface normals of the main camera.");
  reader.read("unlit", spec.unlit, "Colours of the main camera without light.");
  reader.read_choice<Renderer>(
      "renderer", spec.renderer, {{"embree", Renderer::embree}, {"egl", Renderer::egl}, {"auto", Renderer::automatic}},
      "Renderer of pinhole cameras. embree: rays on the CPU, the same bits on every machine. egl: OpenGL. auto: egl "
      "where its device is hardware.");
  reader.read("egl_device", spec.egl_device, Allowed::text("auto, software, a number, a UUID or cuda:N"),
              "Device of the renderer egl. auto: the first hardware.");
  reader.read("spectrogram", spec.spectrogram, "Log-magnitude spectrogram of the last second, of each channel of the sound.");
  reader.read("interaural", spec.interaural,
              "Level, interaural level difference and interaural phase difference of the last second; needs channels binaural.");
  reader.read("waveform", spec.waveform, "Sound of the step, [channels, samples].");
  reader.read("heard", spec.heard, "Sound of the last second, [channels, samples].");
  reader.read("channels", spec.channels, Allowed::text("channels as of earshot rir"), kChannelsAbout);
  // Files are read where they are used: configs come from others too.
  if (!reader.is_describing() && !names_file(spec.channels)) static_cast<void>(read_layout(reader, "channels", spec.channels));
  reader.read("pointgoal", spec.pointgoal, "Distance and bearing of the goal.");
  reader.read("gps_compass", spec.gps_compass, "Metres ahead of and right of the start, and radians turned since.");
  reader.read("pose", spec.pose, "Values of gps_compass, and seconds since the start.");
  reader.read("collision", spec.collision, "Whether the last step met an obstacle.");
  reader.read("previous_action", spec.previous_action, "Last action; -1 before the first.");
  reader.read("topdown_map", spec.topdown_map, "Map of the walkable surface, the path and the agent, set by map.");
  reader.read("oracle_action", spec.oracle_action, "Action of the oracle; privileged, for learners.");
  reader.read("goal_state", spec.goal_state,
              "Distances to the goal and bearings of the goal and the next corner; privileged, for learners.");
  reader.read("legacy_spectrogram", spec.legacy_spectrogram,
              "Spectrogram of the new samples alone, zero-padded to a second, as in SoundSpaces 2.0.");
  read_cameras(reader, spec);
  read_noise(reader, spec);
  ConfigReader map = reader.child("map", "Picture of topdown_map.");
  read(map, spec.map);
  map.finish();
}

void validate(const ObservationSpec& spec) {
  require(!sensor_table(spec, 1).empty(), "observation", "(empty)", "must have at least one sensor: the policy needs an input");
  require(spec.spectrogram || !spec.legacy_spectrogram, "observation.legacy_spectrogram", true,
          "has no effect without observation.spectrogram");
  check_values(spec, "observation");
  const int num_channels = spec.layout().num_channels();
  require(num_channels <= kMaxSoundChannels, "observation.channels", spec.channels,
          fmt::format("has {} channels; environments take at most {}", num_channels, kMaxSoundChannels));
  require(spec.has_ears() || !spec.interaural, "observation.interaural", true, "needs observation.channels: binaural");
  const TopdownMapConfig untouched;
  const auto require_map = [&](bool is_default, const char* key, const auto& value) {
    require(spec.topdown_map || is_default, key, value, "has no effect without observation.topdown_map");
  };
  require_map(spec.map.size_px == untouched.size_px, "observation.map.size_px", spec.map.size_px);
  require_map(spec.map.metres_per_px == untouched.metres_per_px, "observation.map.metres_per_px", spec.map.metres_per_px);
  require_map(spec.map.frame == untouched.frame, "observation.map.frame", "allocentric");
  require_map(spec.map.goal == untouched.goal, "observation.map.goal", true);
  const PoseNoiseConfig& pose_noise = spec.pose_noise;
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
  const bool pinholes = std::ranges::any_of(all, [](const ExtraCamera& camera) { return camera.config.projection == Projection::pinhole; });
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
