// SPDX-License-Identifier: Apache-2.0
#include "datasets/sound_scene_config.h"

#include <fmt/format.h>

#include <algorithm>

#include "sim/base/errors.h"
#include "sim/base/text/config_reader.h"
#include "sim/base/text/listed.h"

namespace earshot {
namespace {

template <class T>
std::string shown(const std::vector<T>& values) {
  return fmt::format("[{}]", listed(values, ", "));
}

void read_classes(ConfigReader& reader, std::vector<SoundClass>& classes) {
  ConfigReader map = reader.child("classes", "Classes of sounds by name; their order is their index.");
  const std::vector<std::string> names = map.free_keys("NAME");
  if (!names.empty()) classes.clear();
  for (const std::string& name : names) {
    SoundClass added{name, {}};
    map.read(name, added.sounds, Allowed::text("a file, a folder or synth:KIND").or_single(),
             "Sounds of a class: files, folders, or synth:KIND, whose instances are drawn.");
    classes.push_back(std::move(added));
  }
  map.finish();
}

}  // namespace

void read(ConfigReader& reader, SoundSceneConfig& config) {
  reader.refuse({"sources_per_room", "listeners_per_source", "shared_listeners", "max_height_difference_m", "rt60_s", "drr_db", "split_ms",
                 "sofa", "hrtfs", "stated_errors", "panorama"},
                "has no effect on recordings");
  read(reader, config.rooms);
  reader.read("recordings_per_room", config.recordings_per_room, Allowed::between(1, 10000), "Recordings in each room.");
  reader.read("duration_s", config.duration_s, Allowed::between(0.2, 600), "Duration of a recording.");
  read_classes(reader, config.classes);
  reader.read("events", config.events, Allowed::between(1, 100).interval(),
              "Sound events of a recording, before max_overlap leaves some out.");
  reader.read("event_s", config.event_s, Allowed::between(0.1, 600).interval(), "Duration of an event, at most duration_s; a sound loops.");
  reader.read("max_overlap", config.max_overlap, Allowed::between(1, 100), "Largest number of events at the same time.");
  reader.read("moving", config.moving, Allowed::between(0, 1), "Fraction of the events whose source moves.");
  reader.read("speed_m_per_s", config.speed_m_per_s, Allowed::between(0.01, 10).interval(), "Speed of moving sources.");
  reader.read("event_db", config.event_db, Allowed::between(-60, 60).interval(), "Level of an event's dry sound relative to the others.");
  reader.read("noise", config.noise, Allowed::text("synth, or a folder"), "Background noise, unrelated between channels. Empty: none.");
  reader.read("snr_db", config.snr_db, Allowed::between(-60, 120).interval(), "Level of all events over the noise.");
  reader.read("level_dbfs", config.level_dbfs, Allowed::between(-100, 0).interval(), "Level of a recording.");
  reader.read("skip_bad", config.skip_bad,
              "Leave out sound files that cannot be decoded or are silent, as inputs.jsonl lists them. false: such a file is refused.");
}

void validate(const SoundSceneConfig& config) {
  check_values(config, "");
  validate(config.rooms);
  if (config.classes.empty())
    throw InputError("classes", "lists no class of sounds", "write for example classes: {speech: folder/of/speech, alarm: synth:alarm}");
  require(config.classes.size() <= 1000, "classes", config.classes.size(), "must be at most 1000");
  for (const SoundClass& sounds : config.classes)
    if (sounds.sounds.empty()) throw InputError("classes." + sounds.name, "lists no sound", "give a file, a folder or synth:KIND");
  require(config.event_s[1] <= config.duration_s, "event_s", shown(config.event_s), "must not exceed duration_s");
}

SoundSceneConfig load_sound_scene_config(const std::string& path, const std::vector<std::string>& overrides) {
  ConfigReader reader = ConfigReader::from_file(path, overrides);
  SoundSceneConfig config;
  read(reader, config);
  reader.finish();
  validate(config);
  return config;
}

std::string config_text(const SoundSceneConfig& config) {
  std::string text = config_text(config.rooms);
  if (!text.ends_with('\n')) text += '\n';
  const auto add = [&](const std::string& key, const auto& value) { text += fmt::format("{}: {}\n", key, value); };
  add("recordings_per_room", config.recordings_per_room);
  add("duration_s", config.duration_s);
  for (const SoundClass& sounds : config.classes) add("classes." + sounds.name, shown(sounds.sounds));
  add("events", shown(config.events));
  add("event_s", shown(config.event_s));
  add("max_overlap", config.max_overlap);
  add("moving", config.moving);
  add("speed_m_per_s", shown(config.speed_m_per_s));
  add("event_db", shown(config.event_db));
  add("noise", config.noise);
  add("snr_db", shown(config.snr_db));
  add("level_dbfs", shown(config.level_dbfs));
  add("skip_bad", config.skip_bad);
  return text;
}

}  // namespace earshot
