#include "datasets/sound_scene_config.h"

#include <fmt/format.h>

#include <algorithm>

#include "sim/base/errors.h"
#include "sim/base/text/listed.h"

namespace earshot {
namespace {

template <class T>
std::string shown(const std::vector<T>& values) {
  return fmt::format("[{}]", listed(values, ", "));
}

template <class T>
void validate_range(const std::vector<T>& range, const std::string& key, T low, T high) {
  const bool ok = range.size() == 2 && range[0] >= low && range[1] <= high && range[0] <= range[1];
  require(ok, key, shown(range), fmt::format("must be two numbers in [{}, {}], in increasing order", low, high));
}

void read_classes(ConfigReader& reader, std::vector<SoundClass>& classes) {
  ConfigReader map = reader.child("classes");
  const std::vector<std::string> names = map.keys();
  if (!names.empty()) classes.clear();
  for (const std::string& name : names) {
    SoundClass added{name, {}};
    if (const auto sound = map.scalar(name))
      added.sounds = {*sound};
    else
      map.read(name, added.sounds);
    classes.push_back(std::move(added));
  }
  map.finish();
}

}  // namespace

void read(ConfigReader& reader, SoundSceneConfig& config) {
  for (const char* key : {"sources_per_room", "listeners_per_source", "shared_listeners", "split_ms", "sofa", "hrtfs", "panorama"})
    if (reader.has(key)) reader.fail(key, "has no effect on recordings");
  read(reader, config.rooms);
  reader.read("recordings_per_room", config.recordings_per_room);
  reader.read("duration_s", config.duration_s);
  read_classes(reader, config.classes);
  reader.read("events", config.events);
  reader.read("event_s", config.event_s);
  reader.read("max_overlap", config.max_overlap);
  reader.read("moving", config.moving);
  reader.read("speed_m_per_s", config.speed_m_per_s);
  reader.read("event_db", config.event_db);
  reader.read("noise", config.noise);
  reader.read("snr_db", config.snr_db);
  reader.read("level_dbfs", config.level_dbfs);
}

void validate(const SoundSceneConfig& config) {
  validate(config.rooms);
  require(config.recordings_per_room >= 1 && config.recordings_per_room <= 10000, "recordings_per_room", config.recordings_per_room,
          "must be in [1, 10000]");
  require(config.duration_s >= 0.2f && config.duration_s <= 600, "duration_s", config.duration_s, "must be in [0.2, 600] s");
  if (config.classes.empty())
    throw InputError("classes", "lists no class of sounds", "write for example classes: {speech: folder/of/speech, alarm: synth:alarm}");
  require(config.classes.size() <= 1000, "classes", config.classes.size(), "must be at most 1000");
  for (const SoundClass& sounds : config.classes)
    if (sounds.sounds.empty()) throw InputError("classes." + sounds.name, "lists no sound", "give a file, a folder or synth:KIND");
  validate_range(config.events, "events", 1, 100);
  validate_range(config.event_s, "event_s", 0.1f, config.duration_s);
  require(config.max_overlap >= 1 && config.max_overlap <= 100, "max_overlap", config.max_overlap, "must be in [1, 100]");
  require(config.moving >= 0 && config.moving <= 1, "moving", config.moving, "must be in [0, 1]: a fraction of the events");
  validate_range(config.speed_m_per_s, "speed_m_per_s", 0.01f, 10.f);
  validate_range(config.event_db, "event_db", -60.f, 60.f);
  validate_range(config.snr_db, "snr_db", -60.f, 120.f);
  validate_range(config.level_dbfs, "level_dbfs", -100.f, 0.f);
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
  return text;
}

}  // namespace earshot
