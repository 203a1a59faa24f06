#include "datasets/rir_corpus_config.h"

#include <algorithm>
#include <cmath>

#include "sim/audio/head/directivity.h"
#include "sim/base/errors.h"

namespace earshot {
namespace {

/// The late field carries harmonics up to here.
constexpr int kTracedOrder = 5;

void read(ConfigReader& reader, ShoeboxRooms& rooms) {
  reader.read("count", rooms.count);
  reader.read("min_size_m", rooms.min_size_m);
  reader.read("max_size_m", rooms.max_size_m);
  reader.read("absorption", rooms.absorption);
  reader.read("walls", rooms.walls);
  reader.read("floor", rooms.floor);
  reader.read("ceiling", rooms.ceiling);
}

void read(ConfigReader& reader, AcousticRandomization& randomization) {
  reader.read("candidates", randomization.candidates);
  reader.read("noise_std", randomization.noise_std);
  reader.read("transmission_noise_db", randomization.transmission_noise_db);
}

std::string shown(const std::vector<float>& values) {
  std::string text = "[";
  for (const float value : values) text += (text.size() > 1 ? ", " : "") + std::to_string(value);
  return text + "]";
}

/// Two numbers within [low, high], the first no larger than the second.
void validate_range(const std::vector<float>& range, const std::string& key, float low, float high, const std::string& rule) {
  const bool ok = range.size() == 2 && range[0] >= low && range[1] <= high && range[0] <= range[1];
  require(ok, key, shown(range), rule);
}

void validate(const ShoeboxRooms& rooms) {
  require(rooms.count >= 0 && rooms.count <= 10'000'000, "shoeboxes.count", rooms.count, "must be in [0, 10000000]");
  require(rooms.min_size_m.size() == 3 && std::ranges::all_of(rooms.min_size_m, [](float v) { return v >= 1; }), "shoeboxes.min_size_m",
          shown(rooms.min_size_m), "must be three sizes of at least 1 m: x, y (height), z");
  bool ordered = rooms.max_size_m.size() == 3;
  for (std::size_t axis = 0; ordered && axis < 3; ++axis)
    ordered = rooms.max_size_m[axis] >= rooms.min_size_m[axis] && rooms.max_size_m[axis] <= 1000;
  require(ordered, "shoeboxes.max_size_m", shown(rooms.max_size_m), "must be three sizes between shoeboxes.min_size_m and 1000 m");
  validate_range(rooms.absorption, "shoeboxes.absorption", 0.001f, 1.f, "must be two numbers in [0.001, 1], in increasing order");
}

}  // namespace

void read(ConfigReader& reader, RirCorpusConfig& config) {
  reader.read("seed", config.seed);
  ConfigReader shoeboxes = reader.child("shoeboxes");
  read(shoeboxes, config.shoeboxes);
  shoeboxes.finish();
  reader.read("scenes", config.scenes);
  reader.read("rooms_per_scene", config.rooms_per_scene);
  if (reader.has("randomize") && !config.randomize) config.randomize.emplace();
  if (config.randomize) {
    ConfigReader randomize = reader.child("randomize");
    read(randomize, *config.randomize);
    randomize.finish();
  }
  reader.read("sources_per_room", config.sources_per_room);
  reader.read("listeners_per_source", config.listeners_per_source);
  reader.read("shared_listeners", config.shared_listeners);
  reader.read("source_height_m", config.source_height_m);
  reader.read("listener_height_m", config.listener_height_m);
  reader.read("clearance_m", config.clearance_m);
  reader.read("min_distance_m", config.min_distance_m);
  reader.read("max_distance_m", config.max_distance_m);
  reader.read("source_patterns", config.source_patterns);
  reader.read("pitch_deg", config.pitch_deg);
  reader.read("roll_deg", config.roll_deg);
  reader.read("channels", config.channels);
  reader.read("hrtf", config.hrtf);
  reader.read("hrtfs", config.hrtfs);
  reader.read_choice<SoundFormat>("format", config.format, {{"wav", SoundFormat::wav}, {"flac", SoundFormat::flac}});
  reader.read("sofa", config.sofa);
  reader.read("split_ms", config.split_ms);
  if (reader.has("panorama") && !config.panorama) config.panorama.emplace();
  if (config.panorama) {
    ConfigReader panorama = reader.child("panorama");
    panorama.read("width_px", config.panorama->width_px);
    panorama.read("height_px", config.panorama->height_px);
    panorama.finish();
  }
  reader.read("rooms_per_folder", config.rooms_per_folder);

  ConfigReader acoustics = reader.child("acoustics");
  std::string preset;
  acoustics.read("preset", preset);
  if (!preset.empty()) {
    config.acoustics = acoustic_preset(preset);
    config.acoustics.rir_length_s = RirCorpusConfig().acoustics.rir_length_s;
  }
  // What the channels need, as `earshot rir` chooses it, unless the file says otherwise.
  const ListenerLayout layout = ListenerLayout::named(config.channels);
  if (layout.kind == ListenerKind::ambisonics)
    config.acoustics.sh_order = std::clamp(layout.order, config.acoustics.sh_order, kTracedOrder);
  if (layout.kind == ListenerKind::mono && !acoustics.has("sh_order")) config.acoustics.sh_order = 0;
  const AcousticConfig before = config.acoustics;
  read(acoustics, config.acoustics);
  if (config.acoustics.threads != before.threads) acoustics.fail("threads", "has no effect in this config; use the option --threads");
  if (config.acoustics.temporal_reuse != before.temporal_reuse) acoustics.fail("temporal_reuse", "has no effect on single responses");
  if (config.acoustics.glide_paths != before.glide_paths) acoustics.fail("glide_paths", "has no effect on single responses");
  acoustics.finish();
}

void validate(const RirCorpusConfig& config) {
  validate(config.shoeboxes);
  if (config.shoeboxes.count == 0 && config.scenes.empty())
    throw InputError("shoeboxes.count, scenes", "give no room", "set shoeboxes: {count: 100}, or scenes: [house:0..9]");
  require(config.rooms_per_scene >= 1 && config.rooms_per_scene <= 1'000'000, "rooms_per_scene", config.rooms_per_scene,
          "must be in [1, 1000000]");
  if (config.randomize) validate(*config.randomize, "randomize");
  require(config.sources_per_room >= 1 && config.sources_per_room <= 65000, "sources_per_room", config.sources_per_room,
          "must be in [1, 65000]");
  require(config.listeners_per_source >= 1 && config.listeners_per_source <= 65000, "listeners_per_source", config.listeners_per_source,
          "must be in [1, 65000]");
  validate_range(config.source_height_m, "source_height_m", 0.05f, 100.f, "must be two heights in [0.05, 100] m, in increasing order");
  validate_range(config.listener_height_m, "listener_height_m", 0.05f, 100.f, "must be two heights in [0.05, 100] m, in increasing order");
  require(config.clearance_m >= 0.05f && config.clearance_m <= 10, "clearance_m", config.clearance_m, "must be in [0.05, 10] m");
  require(config.min_distance_m >= 0, "min_distance_m", config.min_distance_m, "must not be negative");
  require(config.max_distance_m > config.min_distance_m && std::isfinite(config.max_distance_m), "max_distance_m", config.max_distance_m,
          "must be finite and above min_distance_m");
  if (config.source_patterns.empty()) throw InputError("source_patterns", "is empty", "give at least one, for example omni");
  for (const std::string& pattern : config.source_patterns) (void)Directivity::named(pattern);
  validate_range(config.pitch_deg, "pitch_deg", -90.f, 90.f, "must be two angles in [-90, 90] degrees, in increasing order");
  validate_range(config.roll_deg, "roll_deg", -180.f, 180.f, "must be two angles in [-180, 180] degrees, in increasing order");
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
  require(config.split_ms >= 0 && config.split_ms < 1000 * config.acoustics.rir_length_s, "split_ms", config.split_ms,
          "must be at least 0 and below acoustics.rir_length_s");
  if (config.panorama) {
    const auto [width_px, height_px] = *config.panorama;
    require(width_px >= 8 && width_px <= 4096 && height_px >= 4 && 2 * height_px <= width_px, "panorama",
            std::to_string(width_px) + "x" + std::to_string(height_px),
            "must be 8 to 4096 pixels wide and at most half as high: the width spans 360 degrees, the height at most 180");
  }
  require(config.rooms_per_folder >= 1 && config.rooms_per_folder <= 10000, "rooms_per_folder", config.rooms_per_folder,
          "must be in [1, 10000]");
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
