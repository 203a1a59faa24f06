// SPDX-License-Identifier: Apache-2.0
#include "datasets/rir_corpus_config.h"

#include <algorithm>

#include "sim/acoustics/synthesis/channel_order.h"
#include "sim/audio/head/directivity.h"
#include "sim/base/errors.h"
#include "sim/base/text/config_reader.h"

namespace earshot {
namespace {

std::string shown(const std::vector<float>& values) {
  std::string text = "[";
  for (const float value : values) text += (text.size() > 1 ? ", " : "") + std::to_string(value);
  return text + "]";
}

void validate(const ShoeboxRooms& rooms) {
  bool ordered = true;
  for (std::size_t axis = 0; axis < 3; ++axis) ordered = ordered && rooms.max_size_m[axis] >= rooms.min_size_m[axis];
  require(ordered, "shoeboxes.max_size_m", shown(rooms.max_size_m), "must be three sizes of at least shoeboxes.min_size_m");
}

void read_shoeboxes(ConfigReader& reader, ShoeboxRooms& rooms) {
  ConfigReader child = reader.child("shoeboxes", "Empty rooms of random size and absorption.");
  const Allowed size = Allowed::between(1, 1000).items(3);
  child.read("count", rooms.count, Allowed::between(0, 10'000'000), "Number of rooms.");
  child.read("min_size_m", rooms.min_size_m, size, "Smallest size along x, y (height) and z.");
  child.read("max_size_m", rooms.max_size_m, size, "Largest size along x, y (height) and z.");
  child.read("absorption", rooms.absorption, Allowed::between(0.001, 1).interval(),
             "Absorption coefficients, one for each wall; uniform in the logarithm.");
  const Allowed material = Allowed::text("the name of a material");
  child.read("walls", rooms.walls, material, "Materials of the walls, one drawn for each. Empty: absorption decides.");
  child.read("floor", rooms.floor, material, "Materials of the floor. Empty: absorption decides.");
  child.read("ceiling", rooms.ceiling, material, "Materials of the ceiling. Empty: absorption decides.");
  child.finish();
}

void read_rooms(ConfigReader& reader, RirCorpusConfig& config) {
  reader.read("seed", config.seed, "Seed of the corpus.");
  read_shoeboxes(reader, config.shoeboxes);
  reader.read("scenes", config.scenes, Allowed::text("a SCENE or a folder"),
              "Scenes (house:0..99 stands for a hundred), or folders of meshes and scene YAMLs.");
  reader.read("rooms_per_scene", config.rooms_per_scene, Allowed::between(1, 1'000'000),
              "Number of times that each scene comes; with randomize each time with other materials.");
  if (reader.asks_for("randomize") && !config.randomize) config.randomize.emplace().noise_std = kPaperNoiseStd;
  if (!config.randomize) return;
  ConfigReader randomize =
      reader.child("randomize", "Random materials in every room; {} takes the defaults, with the noise of SoundSpaces 2.0.");
  read(randomize, *config.randomize);
  randomize.finish();
}

void read_places(ConfigReader& reader, RirCorpusConfig& config) {
  const Allowed count = Allowed::between(1, 65000), height = Allowed::between(0.05, 100).interval();
  reader.read("sources_per_room", config.sources_per_room, count, "Sources in each room.");
  reader.read("listeners_per_source", config.listeners_per_source, count, "Listeners of each source.");
  reader.read("shared_listeners", config.shared_listeners, "All sources of a room have the same listeners, which mixtures need.");
  reader.read("source_height_m", config.source_height_m, height, "Height of sources above the floor.");
  reader.read("listener_height_m", config.listener_height_m, height, "Height of listeners above the floor.");
  reader.read("clearance_m", config.clearance_m, Allowed::between(0.05, 10), "Distance of places from walls, furniture and the ceiling.");
  reader.read("min_distance_m", config.min_distance_m, Allowed::at_least(0), "Shortest distance from source to listener.");
  reader.read("max_distance_m", config.max_distance_m, Allowed::above(0), "Longest distance from source to listener.");
  reader.read("max_height_difference_m", config.max_height_difference_m, Allowed::above(0),
              "Largest difference in height between source and listener.");
  reader.read("source_patterns", config.source_patterns, Allowed::text("a directional pattern"),
              "Directional patterns, one drawn for each source, which faces anywhere.");
  reader.read("pitch_deg", config.pitch_deg, Allowed::between(-90, 90).interval(), "Pitch of listeners; headings are anywhere.");
  reader.read("roll_deg", config.roll_deg, Allowed::between(-180, 180).interval(), "Roll of listeners.");
}

void read_wishes(ConfigReader& reader, RirCorpusConfig& config) {
  reader.read(
      "rt60_s", config.rt60_s, Allowed::between(0, 100).interval(),
      "Reverberation times (t20_mid_s): rooms are drawn again until each tenth of the range comes equally often. [0, 0]: as the rooms.");
  reader.read("drr_db", config.drr_db, Allowed::between(-100, 100).interval(),
              "Direct-to-reverberant ratios: listeners are drawn again in the same way. [0, 0]: as the places.");
}

void read_files(ConfigReader& reader, RirCorpusConfig& config) {
  reader.read("channels", config.channels, Allowed::text("channels as of earshot rir"), kChannelsAbout);
  reader.read("hrtf", config.hrtf, Allowed::text("a SOFA file"),
              "SOFA file with HRTFs for binaural channels. Empty: a rigid sphere of radius 8.75 cm.");
  reader.read("hrtfs", config.hrtfs, Allowed::text("a SOFA file, or sphere"),
              "SOFA files with HRTFs, one drawn for each listener; at most 1,000. Empty: hrtf for all.");
  reader.read_choice<SoundFormat>("format", config.format, {{"wav", SoundFormat::wav}, {"flac", SoundFormat::flac}},
                                  "Format of sound files: 32-bit WAV, or FLAC of at most 8 channels.");
  reader.read("sofa", config.sofa, "One SOFA file (SingleRoomSRIR) per source in place of sound files.");
  reader.read("split_ms", config.split_ms, Allowed::at_least(0),
              "Time after the direct sound at which a response is split into an early and a late file. 0: no split.");
  reader.read("stated_errors", config.stated_errors,
              "Standard errors of t20_s in the manifest. Costs at least one more trace per response, nothing with a field.");
  if (reader.asks_for("panorama") && !config.panorama) config.panorama.emplace();
  if (config.panorama) {
    ConfigReader panorama = reader.child("panorama", "Panoramas of colour, depth and category from the places of the listeners.");
    panorama.read("width_px", config.panorama->width_px, Allowed::between(8, 4096), "Width, over 360 degrees.");
    panorama.read("height_px", config.panorama->height_px, Allowed::between(4, 2048), "Height; without views at most half of the width.");
    panorama.read(
        "views", config.panorama->views, Allowed::between(0, 360),
        "Pinhole pictures side by side that make up the panorama, of 360 / views degrees each. 0: one picture, uniform in angle.");
    panorama.finish();
  }
  reader.read("rooms_per_folder", config.rooms_per_folder, Allowed::between(1, 10000), "Rooms in each folder of the corpus.");
}

void read_acoustics(ConfigReader& reader, RirCorpusConfig& config) {
  ConfigReader acoustics = reader.child("acoustics", "Simulation of responses: a preset, and keys over it.");
  std::string preset;
  acoustics.read("preset", preset, Allowed::text("fast, balanced or high"),
                 "Preset that the other keys start from: fast (training), balanced or high (reference). Empty: fast.");
  if (!preset.empty()) {
    config.acoustics = acoustic_preset(preset);
    config.acoustics.rir_length_s = RirCorpusConfig().acoustics.rir_length_s;
  }
  // Settings for the channels as in `earshot rir`, unless the file sets them.
  const ListenerLayout layout = ListenerLayout::named(config.channels);
  config.acoustics.sh_order = harmonics_of(layout, config.acoustics);
  const AcousticConfig before = config.acoustics;
  read(acoustics, config.acoustics);
  if (config.acoustics.threads != before.threads) acoustics.fail("threads", "has no effect in this config; use the option --threads");
  if (config.acoustics.temporal_reuse != before.temporal_reuse) acoustics.fail("temporal_reuse", "has no effect on single responses");
  if (config.acoustics.glide_paths != before.glide_paths) acoustics.fail("glide_paths", "has no effect on single responses");
  if (acoustics.is_describing()) acoustics.refuse({"threads", "temporal_reuse", "glide_paths"}, "has no effect here");
  acoustics.finish();
}

void validate_wishes(const RirCorpusConfig& config) {
  const auto is_valid = [](const std::vector<float>& range) { return is_range(range) || (range[0] == 0 && range[1] == 0); };
  require(is_valid(config.rt60_s), "rt60_s", shown(config.rt60_s), "must be [LOW, HIGH] with LOW < HIGH; [0, 0]: as the rooms");
  require(is_valid(config.drr_db), "drr_db", shown(config.drr_db), "must be [LOW, HIGH] with LOW < HIGH; [0, 0]: as the places");
  if (is_range(config.rt60_s) && !config.scenes.empty() && !config.randomize)
    throw InputError("rt60_s", "cannot be drawn in scenes whose materials are fixed", "add randomize: {}, or leave out scenes");
  if (is_range(config.drr_db) && config.shared_listeners)
    throw InputError("drr_db", "cannot be drawn with shared_listeners: true: a listener has another ratio for each source",
                     "leave out one of the two keys");
}

}  // namespace

void read(ConfigReader& reader, RirCorpusConfig& config) {
  read_rooms(reader, config);
  read_places(reader, config);
  read_wishes(reader, config);
  read_files(reader, config);
  read_acoustics(reader, config);
}

void validate(const RirCorpusConfig& config) {
  check_values(config, "");
  validate(config.shoeboxes);
  if (config.shoeboxes.count == 0 && config.scenes.empty())
    throw InputError("shoeboxes.count, scenes", "give no room", "set shoeboxes: {count: 100}, or scenes: [house:0..9]");
  require(config.max_distance_m > config.min_distance_m, "max_distance_m", config.max_distance_m, "must be above min_distance_m");
  validate_wishes(config);
  if (config.source_patterns.empty()) throw InputError("source_patterns", "is empty", "give at least one, for example omni");
  for (const std::string& pattern : config.source_patterns) (void)Directivity::named(pattern);
  const ListenerLayout layout = ListenerLayout::named(config.channels);
  if (!config.hrtf.empty() && layout.kind != ListenerKind::binaural)
    throw InputError("hrtf", "has no effect with channels '" + config.channels + "'", "leave it out, or set channels: binaural");
  if (!config.hrtfs.empty() && layout.kind != ListenerKind::binaural)
    throw InputError("hrtfs", "has no effect with channels '" + config.channels + "'", "leave it out, or set channels: binaural");
  if (!config.hrtfs.empty() && !config.hrtf.empty())
    throw InputError("hrtf, hrtfs", "are both set", "set hrtf for a single head, or hrtfs for a list to draw from");
  require(config.hrtfs.size() <= 1000, "hrtfs", config.hrtfs.size(), "must be at most 1000 files");
  if (config.sofa && config.format != SoundFormat::wav)
    throw InputError("format", "has no effect with sofa: true", "leave out either this key or sofa");
  if (config.sofa && config.split_ms > 0)
    throw InputError("split_ms", "has no effect with sofa: true, because SOFA files contain undivided responses",
                     "leave out either this key or sofa");
  require(config.format == SoundFormat::wav || layout.num_channels() <= 8, "format", "flac",
          "supports at most 8 channels; use format: wav");
  validate(config.acoustics);
  require(config.acoustics.rir_length_s > 0, "acoustics.rir_length_s", "auto",
          "must be a number: all responses of a corpus have the same length");
  require(config.split_ms < 1000 * config.acoustics.rir_length_s, "split_ms", config.split_ms,
          "must be at least 0 and below acoustics.rir_length_s");
  if (config.panorama) {
    const auto [width_px, height_px, views] = *config.panorama;
    const std::string size = std::to_string(width_px) + "x" + std::to_string(height_px);
    require(views == 0 || (views >= 3 && width_px % views == 0), "panorama.views", views,
            "must be 0, or at least 3 and a divisor of width_px (" + std::to_string(width_px) + ")");
    require(views > 0 || 2 * height_px <= width_px, "panorama", size,
            "must be at most half as high as wide: the width spans 360 degrees, the height at most 180");
  }
}

RirCorpusConfig load_rir_corpus_config(const std::string& path, const std::vector<std::string>& overrides) {
  ConfigReader reader = ConfigReader::from_file(path, overrides);
  RirCorpusConfig config;
  read(reader, config);
  reader.finish();
  validate(config);
  return config;
}

std::string config_text(const RirCorpusConfig& config) {
  ConfigReader recorder = ConfigReader::recorder();
  RirCorpusConfig copy = config;
  read(recorder, copy);
  return recorder.effective();
}

}  // namespace earshot
