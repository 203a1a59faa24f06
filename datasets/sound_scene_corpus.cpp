// SPDX-License-Identifier: Apache-2.0
#include "datasets/sound_scene_corpus.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <cstdlib>
#include <memory>
#include <nlohmann/json.hpp>
#include <numbers>
#include <optional>
#include <set>
#include <utility>

#include "datasets/corpus_parts.h"
#include "datasets/corpus_sounds.h"
#include "datasets/diffuse_level.h"
#include "datasets/inputs/corpus_inputs.h"
#include "datasets/labels/label_number.h"
#include "datasets/rir_corpus_response.h"
#include "datasets/rir_corpus_room.h"
#include "datasets/sound_scene_events.h"
#include "datasets/sound_scene_recorder.h"
#include "sim/acoustics/response/place_check.h"
#include "sim/audio/transforms/low_pass.h"
#include "sim/base/errors.h"
#include "sim/base/files.h"
#include "sim/base/text/json.h"
#include "sim/base/text/utf8.h"

namespace earshot {
namespace {

using Json = nlohmann::ordered_json;

/// Replaces the scene in the random streams of episodes: draws of a recording besides its events.
constexpr std::uint32_t kMixStream = 0x53454C4Du;

struct MixDraw {
  enum : std::uint32_t { level = 0, snr = 1, noise_file = 2, pattern = 64, heading = 256, noise_start = 512 };
};

Json rounded_place(glm::dvec3 position) { return {rounded(position.x), rounded(position.y), rounded(position.z)}; }

/// Inputs common to all rooms of a corpus.
struct SceneInputs {
  const SoundSceneConfig& config;
  const ClassSounds& sounds;
  const SoundFolder* noise = nullptr;  ///< null: none, or noise that is synthesized
  const ListenerLayout& layout;
};

/// One room's recordings.
class RoomRecorder {
 public:
  RoomRecorder(const SceneInputs& inputs, SoundSceneRecorder& recorder, const CorpusRoomSpec& spec, std::size_t room)
      : inputs_(inputs),
        config_(inputs.config),
        recorder_(recorder),
        room_index_(room),
        room_(inputs.config.rooms, room, spec),
        places_(room_.acoustics()) {}

  void record(int recording, CorpusPieceWriter& writer) {
    const SoundScenePlan plan = plan_sound_scene(config_, inputs_.sounds, room_, room_index_, recording);
    const RandomStream random(config_.rooms.seed, Purpose::episode, kMixStream, static_cast<std::uint32_t>(room_index_),
                              static_cast<std::uint32_t>(recording));
    const float rate_hz = config_.rooms.acoustics.sample_rate_hz;
    const auto frames = static_cast<std::size_t>(std::lround(config_.duration_s * rate_hz));
    const auto channels = static_cast<std::size_t>(recorder_.num_channels());
    std::vector<float> mix(channels * frames, 0.f);
    Json events = Json::array();
    for (const SoundEvent& event : plan.events) {
      for (const WalkPoint& point : event.path)
        static_cast<void>(places_.check({"source", point.position}, {"listener", plan.listener.position}));
      const auto number = static_cast<std::uint32_t>(event.number);
      const std::vector<std::string>& patterns = config_.rooms.source_patterns;
      const std::string& pattern = patterns[random.below(static_cast<std::uint32_t>(patterns.size()), MixDraw::pattern + number)];
      const double heading_deg = 0.01 * random.below(36000, MixDraw::heading + number);
      SoundSource source(event.path[0].position);
      source.directivity = Directivity::named(pattern);
      source.orientation = glm::angleAxis(static_cast<float>(heading_deg * std::numbers::pi / 180), glm::vec3(0, 1, 0));
      const std::uint64_t start = recorder_.add({.room = room_, .event = event, .listener = plan.listener, .source = std::move(source)},
                                                {.frames = frames, .samples = mix});
      events.push_back(describe(event, start, pattern, heading_deg));
    }
    Json noise = nullptr;
    if (!config_.noise.empty() && !plan.events.empty()) noise = add_noise(recording, random, frames, mix);

    const double mean_square = energy_of(mix) / static_cast<double>(mix.size());
    double level_dbfs = within_range(config_.level_dbfs, random.uniform(MixDraw::level));
    double factor = mean_square > 0 ? amplitude_of_db(level_dbfs) / std::sqrt(mean_square) : 1;
    const double peak = peak_of(mix);
    const bool lowered = peak * factor > kMaxPeak;
    if (lowered) {
      level_dbfs += 20 * std::log10(kMaxPeak / (peak * factor));
      factor = kMaxPeak / peak;
    }
    scale(mix, factor);

    const std::string id = fmt::format("{:06}_r{:04}", room_index_, recording), name = id + ending_of(config_.rooms.format);
    const Scene& scene = room_.scene();
    const Json line = {{"id", id},
                       {"file", writer.write(name, encode_sound(mix, recorder_.num_channels(), rate_hz, config_.rooms.format, name,
                                                                inputs_.layout.channel_mask))},
                       {"metadata_file", writer.write(id + ".csv", dcase_metadata(plan, config_.duration_s))},
                       {"num_samples", frames},
                       {"scene", scene.name()},
                       {"scene_hash", hex64(scene.hash())},
                       {"room", room_index_},
                       {"listener",
                        {{"position_m", rounded_place(scene.to_world(plan.listener.position))},
                         {"heading_deg", plan.listener.heading_deg},
                         {"pitch_deg", plan.listener.pitch_deg},
                         {"roll_deg", plan.listener.roll_deg}}},
                       {"events", events},
                       {"noise", noise},
                       {"level_dbfs", mean_square > 0 ? rounded(level_dbfs) : Json(nullptr)},
                       {"lowered", lowered}};
    writer.add_line(json_text(line));
  }

 private:
  [[nodiscard]] Json describe(const SoundEvent& event, std::uint64_t start_sample, const std::string& pattern, double heading_deg) const {
    Json path = Json::array();
    for (const WalkPoint& point : event.path) {
      const glm::dvec3 world = room_.scene().to_world(point.position);
      path.push_back({rounded(point.t_s), rounded(world.x), rounded(world.y), rounded(world.z)});
    }
    return {{"class", config_.classes[event.class_index].name},
            {"class_index", event.class_index},
            {"source", event.number},
            {"sound", event.sound},
            {"start_sample", start_sample},
            {"onset_s", rounded(event.onset_s)},
            {"offset_s", rounded(event.offset_s)},
            {"level_db", event.level_db},
            {"pattern", pattern},
            {"heading_deg", heading_deg},
            {"speed_m_per_s", event.speed_m_per_s},
            {"path", path}};
  }

  /// Unrelated between channels, at the levels of a diffuse field.
  Json add_noise(int recording, const RandomStream& random, std::size_t frames, std::vector<float>& mix) const {
    const auto channels = static_cast<std::size_t>(inputs_.layout.num_channels());
    std::string name = "synth";
    std::vector<float> clip;
    if (inputs_.noise) {
      name = inputs_.noise->files[random.below(static_cast<std::uint32_t>(inputs_.noise->files.size()), MixDraw::noise_file)];
      clip = load_sound(inputs_.noise->root / name, config_.rooms.acoustics.sample_rate_hz).samples;
    }
    std::vector<std::uint64_t> starts;
    // In a channel that draws a pause the loudest sample sounds, at a time of its own.
    for (std::size_t c = 0; c < channels && !clip.empty(); ++c) {
      const auto drawn = random.below(static_cast<std::uint32_t>(clip.size()), MixDraw::noise_start + static_cast<std::uint32_t>(c));
      starts.push_back(sounding_start(clip, drawn, 0, frames, c * frames / channels));
    }
    std::vector<float> noise;
    for (std::size_t c = 0; c < channels; ++c) {
      const RandomStream white(config_.rooms.seed, Purpose::sound, kMixStream, static_cast<std::uint32_t>(room_index_),
                               (static_cast<std::uint32_t>(recording) << 9) | static_cast<std::uint32_t>(c));
      std::vector<float> channel = clip.empty() ? white_noise(white, frames) : looped(clip, starts[c], frames);
      scale(channel, static_cast<double>(diffuse_level(inputs_.layout, c)));
      if (inputs_.layout.kind == ListenerKind::array && inputs_.layout.microphones[c].lowpass_hz > 0)
        LowPass(static_cast<double>(inputs_.layout.microphones[c].lowpass_hz), static_cast<double>(config_.rooms.acoustics.sample_rate_hz))
            .filter(channel);
      noise.insert(noise.end(), channel.begin(), channel.end());
    }
    const double energy = energy_of(noise), snr_db = within_range(config_.snr_db, random.uniform(MixDraw::snr));
    if (energy <= 0) throw InputError((inputs_.noise->root / name).string(), "is silent", "remove it from the folder");
    const double gain = std::sqrt(energy_of(mix) / energy) / amplitude_of_db(snr_db);
    for (std::size_t i = 0; i < mix.size(); ++i) mix[i] += static_cast<float>(gain) * noise[i];
    return {{"sound", name}, {"snr_db", rounded(snr_db)}};
  }

  const SceneInputs& inputs_;
  const SoundSceneConfig& config_;
  SoundSceneRecorder& recorder_;
  std::size_t room_index_;
  CorpusRoom room_;
  PlaceCheck places_;
};

std::string group_of(const SoundClass& sound_class) { return "class " + sound_class.name; }

/// Opens the files of all classes and of the noise.  Throws InputError, and where a corpus would lie in a folder that it reads.
CorpusInputs open_inputs(const SoundSceneConfig& config, const CorpusRun& run, const ClassSounds& sounds, const SoundFolder* noise) {
  for (const SoundClass& sound_class : config.classes)
    for (const std::string& sound : sound_class.sounds)
      if (std::filesystem::is_directory(sound)) require_outside(run.out, sound, "classes." + sound_class.name);
  if (noise) require_outside(run.out, noise->root, "noise");
  std::vector<InputFile> files;
  for (std::size_t i = 0; i < sounds.size(); ++i)
    for (const std::string& sound : sounds[i])
      if (!sound.starts_with("synth:")) files.push_back({.group = group_of(config.classes[i]), .name = sound, .path = sound});
  if (noise)
    for (const std::string& file : noise->files) files.push_back({.group = "noise", .name = file, .path = noise->root / file});
  return {std::move(files),
          run.out,
          {.skip_bad = config.skip_bad,
           .sample_rate_hz = config.rooms.acoustics.sample_rate_hz,
           .threads = run.threads,
           .progress = run.opening}};
}

/// Leaves the good files of a class, and what is synthesized.
void keep_good(std::vector<std::string>& sounds, const CorpusInputs& inputs, const SoundClass& sound_class) {
  const std::vector<std::string> good = inputs.good(group_of(sound_class));
  const std::set<std::string> kept(good.begin(), good.end());
  std::erase_if(sounds, [&](const std::string& sound) { return !sound.starts_with("synth:") && !kept.contains(sound); });
  if (sounds.empty())
    throw InputError("classes." + sound_class.name, "has no usable sound file", "repair the files, or give another folder");
}

/// Of the names of all sounds, and of the sizes of those that are files.  Throws InputError: an unknown kind, a file that cannot be read.
std::uint64_t hash_of(const ClassSounds& sounds, float sample_rate_hz) {
  std::string text;
  for (const auto& of_class : sounds)
    for (const std::string& sound : of_class) {
      text += sound;
      if (sound.starts_with("synth:"))
        (void)synthesize_sound(sound, sample_rate_hz);
      else
        text += fmt::format(" {}", sound_file_size(sound));
      text += '\n';
    }
  return hash64(text);
}

/// The events of a recording as lhotse's SupervisionSegments.
std::string supervision_lines(const std::string& manifest_line, std::size_t num_channels) {
  const Json recording = parse_ordered_json(manifest_line);
  Json channels = Json::array();
  for (std::size_t channel = 0; channel < num_channels; ++channel) channels.push_back(channel);
  std::string lines;
  for (const Json& event : recording.at("events")) {
    const double onset_s = event.at("onset_s").get<double>(), offset_s = event.at("offset_s").get<double>();
    lines += json_text(Json{{"id", fmt::format("{}-{}", recording.at("id").get<std::string>(), event.at("source").get<int>())},
                            {"recording_id", recording.at("id")},
                            {"start", onset_s},
                            {"duration", std::round(1e6 * (offset_s - onset_s)) / 1e6},
                            {"channel", channels},
                            {"custom", event}}) +
             "\n";
  }
  return lines;
}

}  // namespace

SoundSceneReport write_sound_scenes(const SoundSceneConfig& config, const CorpusRun& run) {
  validate(config);
  validate(run);
  // All inputs are opened before anything is written.
  ClassSounds sounds = expand_classes(config);
  std::optional<SoundFolder> noise;
  if (!config.noise.empty() && config.noise != "synth") noise = SoundFolder::list(config.noise);
  const float rate_hz = config.rooms.acoustics.sample_rate_hz;
  const ListenerLayout layout = ListenerLayout::named(config.rooms.channels);
  // What does not depend on files is compared before they are opened; names that are no text are refused with the files.
  const std::string settings = config_text(config);
  if (is_utf8(settings))
    CorpusFolder::refuse_others(run.out, CorpusFolder::describe("scenes", settings, rate_hz, layout.channel_names()),
                                {"sounds", "noise_files"});
  const CorpusInputs files = open_inputs(config, run, sounds, noise ? &*noise : nullptr);
  for (std::size_t i = 0; i < sounds.size(); ++i) keep_good(sounds[i], files, config.classes[i]);
  if (noise) noise->files = files.good("noise");
  if (noise && noise->files.empty()) throw InputError("noise", "has no usable sound file", "repair the files, or give another folder");
  const std::uint64_t sounds_hash = hash_of(sounds, rate_hz);
  const std::vector<CorpusRoomSpec> rooms = list_corpus_rooms(config.rooms);
  const CorpusFolder folder(run.out, rooms.size(), static_cast<std::size_t>(config.rooms.rooms_per_folder), rate_hz,
                            static_cast<std::size_t>(layout.num_channels()));
  folder.begin(CorpusFolder::describe(
      "scenes", settings + fmt::format("sounds: {}\nnoise_files: {}\n", hex64(sounds_hash), noise ? hex64(noise->hash()) : "none"), rate_hz,
      layout.channel_names()));
  files.record();
  std::string names;
  for (const SoundClass& sound_class : config.classes) names += sound_class.name + "\n";
  write_file_atomically(run.out / "classes.txt", names);

  const std::shared_ptr<const SynthesisTables> tables = corpus_tables(config.rooms).front();
  const SceneInputs inputs{.config = config, .sounds = sounds, .noise = noise ? &*noise : nullptr, .layout = layout};
  const CorpusPartsReport done = complete_corpus(
      folder, run,
      {.items = [&](std::size_t) { return static_cast<std::uint64_t>(config.recordings_per_room); },
       .make_worker =
           [&] {
             auto recorder = std::make_shared<SoundSceneRecorder>(config, tables);
             return [&, recorder](CorpusPiece piece, CorpusPieceWriter& writer, const std::function<void()>& count_item) {
               RoomRecorder of_room(inputs, *recorder, rooms[piece.part], piece.part);
               for (int recording = 0; recording < config.recordings_per_room; ++recording) {
                 of_room.record(recording, writer);
                 count_item();
               }
             };
           },
       .derived = {{"supervisions.jsonl",
                    [&](const std::string& line) { return supervision_lines(line, static_cast<std::size_t>(layout.num_channels())); }}}});
  return {.recordings = done.items,
          .all_recordings = rooms.size() * static_cast<std::uint64_t>(config.recordings_per_room),
          .folders_missing = done.folders_missing,
          .left_out = files.left_out()};
}

}  // namespace earshot
