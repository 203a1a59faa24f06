// SPDX-License-Identifier: Apache-2.0
#include "envs/episodes/episode_set.h"

#include <algorithm>
#include <cmath>
#include <nlohmann/json.hpp>
#include <optional>
#include <utility>

#include "envs/episodes/gzip.h"
#include "sim/base/errors.h"
#include "sim/base/files.h"
#include "sim/base/regular_file.h"
#include "sim/base/text/json.h"
#include "sim/base/text/json_depth.h"
#include "sim/base/text/json_size.h"
#include "sim/base/text/schema_version.h"

namespace earshot {
namespace {

using nlohmann::json;

constexpr std::size_t kMaxTextBytes = std::size_t{1} << 30;
/// Sets of thousands of episodes shrink ten to thirty times; zeros do a thousand times.
constexpr std::size_t kMaxGrowth = 100, kMinTextBytes = std::size_t{16} << 20;
/// Of one episode, and of what lies around them: an honest one has some tens of values.
constexpr JsonLimits kEpisodeLimits{.values = 2'000'000, .texts = 500'000, .lists = 100'000, .per_depth = 3};
constexpr const char* kGeneratorKey = "earshot_generator";
constexpr const char* kVersionKey = "schema_version";
constexpr std::string_view kScenePrefix = "data/scene_datasets/";
constexpr std::string_view kRemedy = "see docs/reference/formats.md for the format, or write a set with 'earshot dataset episodes'";

/// One JSON episode, with messages that name the episode and the key.
class EpisodeReader {
 public:
  EpisodeReader(const json& episode, std::size_t index, const std::string& where) : episode_(episode), where_(where) {
    const auto id = episode.find("episode_id");
    label_ = id != episode.end() && id->is_string() ? "episode '" + id->get_ref<const std::string&>() + "'"
                                                    : "episode number " + std::to_string(index);
  }

  Episode read() const {
    Episode out;
    const json& id = member(episode_, "episode_id");
    // Some published sets number their episodes instead of naming them.
    out.episode_id = id.is_number_integer() ? json_text(id) : text(id, "episode_id");
    out.scene_id = text(member(episode_, "scene_id"), "scene_id");
    if (out.scene_id.starts_with(kScenePrefix)) out.scene_id.erase(0, kScenePrefix.size());
    if (out.scene_id.empty()) fail("scene_id", "is empty");
    out.start_position = position(member(episode_, "start_position"), "start_position");
    out.start_rotation = rotation(member(episode_, "start_rotation"), "start_rotation");

    const json& goals = member(episode_, "goals");
    if (!goals.is_array() || goals.empty()) fail("goals", "must be a list with at least one goal");
    const json& goal = goals.front();
    if (!goal.is_object()) fail("goals[0]", "must be an object");
    out.goal_position = position(member(goal, "position", "goals[0]."), "goals[0].position");
    if (goal.contains("radius") && !goal["radius"].is_null()) out.goal_radius_m = number(goal["radius"], "goals[0].radius");

    if (goals.size() > kMaxGoals) fail("goals", "must be at most " + std::to_string(kMaxGoals));
    for (std::size_t i = 1; i < goals.size(); ++i) {
      const std::string key = "goals[" + std::to_string(i) + "]";
      if (!goals[i].is_object()) fail(key, "must be an object");
      out.other_goals.push_back(position(member(goals[i], "position", (key + ".").c_str()), key + ".position"));
    }

    const json& info = member(episode_, "info");
    if (!info.is_object()) fail("info", "must be an object");
    out.geodesic_distance_m = number(member(info, "geodesic_distance", "info."), "info.geodesic_distance");
    if (!(out.geodesic_distance_m > 0)) fail("info.geodesic_distance", "must be positive: goal and start must differ");
    const json& actions = member(info, "num_action", "info.");
    if (!actions.is_number_integer() || actions.get<double>() < 1 || actions.get<double>() > 1e9)
      fail("info.num_action", "must be a whole number of at least 1");
    out.num_action = actions.get<int>();
    out.sound = text(member(info, "sound", "info."), "info.sound");
    if (out.sound.empty()) fail("info.sound", "is empty");
    if (const auto sources = episode_.find("sources"); sources != episode_.end() && !sources->is_null()) {
      if (!sources->is_array() || sources->size() > kMaxSources)
        fail("sources", "must be a list of at most " + std::to_string(kMaxSources) + " sources");
      for (std::size_t i = 0; i < sources->size(); ++i) out.sources.push_back(source((*sources)[i], "sources[" + std::to_string(i) + "]"));
    }
    if (const auto noise = episode_.find("noise_snr_db"); noise != episode_.end() && !noise->is_null()) {
      out.noise_snr_db = number(*noise, "noise_snr_db");
      if (std::abs(*out.noise_snr_db) > 200) fail("noise_snr_db", "must be in [-200, 200]");
    }
    read_agents(out);
    return out;
  }

 private:
  EpisodeSource source(const json& value, const std::string& key) const {
    if (!value.is_object()) fail(key, "must be an object");
    const std::string prefix = key + ".";
    for (const auto& [name, unused] : value.items())
      if (name != "position" && name != "sound" && name != "onset_s" && name != "duration_s" && name != "loop" && name != "goal" &&
          name != "level_db" && name != "path")
        fail(prefix + name, "is not a key of a source");
    EpisodeSource out;
    out.position = position(member(value, "position", prefix.c_str()), prefix + "position");
    out.sound = text(member(value, "sound", prefix.c_str()), prefix + "sound");
    if (out.sound.empty()) fail(prefix + "sound", "is empty");
    if (value.contains("onset_s")) out.onset_s = static_cast<double>(number(value["onset_s"], prefix + "onset_s"));
    if (out.onset_s < 0 || out.onset_s > 1e6) fail(prefix + "onset_s", "must be in [0, 1e6]");
    if (value.contains("duration_s")) out.duration_s = static_cast<double>(number(value["duration_s"], prefix + "duration_s"));
    if (out.duration_s > 1e6) fail(prefix + "duration_s", "must be at most 1e6; negative: no end");
    if (value.contains("loop")) out.loop = flag(value["loop"], prefix + "loop");
    if (value.contains("goal")) out.goal = flag(value["goal"], prefix + "goal");
    if (value.contains("level_db")) out.level_db = number(value["level_db"], prefix + "level_db");
    if (out.level_db < -120 || out.level_db > 60) fail(prefix + "level_db", "must be in [-120, 60]");
    if (value.contains("path")) out.path = path(value["path"], prefix + "path");
    return out;
  }
  void read_agents(Episode& out) const {
    const auto read_sound = [&](const json& value, const std::string& sound_key, const std::string& level_key, const std::string& prefix,
                                std::string& sound, float& level_db) {
      if (value.contains(sound_key)) {
        sound = text(value[sound_key], prefix + sound_key);
        if (sound.empty()) fail(prefix + sound_key, "is empty");
      }
      if (!value.contains(level_key)) return;
      if (sound.empty()) fail(prefix + level_key, "has no effect without " + sound_key);
      level_db = number(value[level_key], prefix + level_key);
      if (level_db < -120 || level_db > 60) fail(prefix + level_key, "must be in [-120, 60]");
    };
    read_sound(episode_, "agent_sound", "agent_level_db", "", out.agent_sound, out.agent_level_db);
    const auto agents = episode_.find("agents");
    if (agents == episode_.end() || agents->is_null()) return;
    if (!agents->is_array() || agents->size() >= kMaxAgents)
      fail("agents", "must be a list of at most " + std::to_string(kMaxAgents - 1) + " agents (without the first one)");
    for (std::size_t i = 0; i < agents->size(); ++i) {
      const json& value = (*agents)[i];
      const std::string key = "agents[" + std::to_string(i) + "]", prefix = key + ".";
      if (!value.is_object()) fail(key, "must be an object");
      for (const auto& [name, unused] : value.items())
        if (name != "start_position" && name != "start_rotation" && name != "sound" && name != "level_db")
          fail(prefix + name, "is not a key of an agent");
      EpisodeAgent agent;
      agent.start_position = position(member(value, "start_position", prefix.c_str()), prefix + "start_position");
      agent.start_rotation = rotation(member(value, "start_rotation", prefix.c_str()), prefix + "start_rotation");
      read_sound(value, "sound", "level_db", prefix, agent.sound, agent.level_db);
      out.other_agents.push_back(std::move(agent));
    }
  }
  std::array<float, 4> rotation(const json& value, const std::string& key) const {
    const std::array<float, 4> q = numbers<4>(value, key);
    if (q[0] * q[0] + q[1] * q[1] + q[2] * q[2] + q[3] * q[3] < 1e-12f) fail(key, "is a zero quaternion");
    return q;
  }
  std::vector<Waypoint> path(const json& value, const std::string& key) const {
    if (!value.is_array() || value.size() > kMaxWaypoints)
      fail(key, "must be a list of at most " + std::to_string(kMaxWaypoints) + " places");
    std::vector<Waypoint> out;
    for (std::size_t i = 0; i < value.size(); ++i) {
      const std::string item = key + "[" + std::to_string(i) + "]";
      numbers<4>(value[i], item);  // seconds, x, y, z
      out.push_back({.t_s = value[i][0].get<double>(),
                     .position = {value[i][1].get<double>(), value[i][2].get<double>(), value[i][3].get<double>()}});
      if (out.back().t_s < 0 || out.back().t_s > 1e6 || (i > 0 && out.back().t_s <= out[i - 1].t_s))
        fail(item, "must be larger than the time before it, within 0 to 1e6 s");
    }
    return out;
  }
  bool flag(const json& value, const std::string& key) const {
    if (!value.is_boolean()) fail(key, "must be true or false");
    return value.get<bool>();
  }
  const json& member(const json& object, const char* key, const char* prefix = "") const {
    const auto found = object.find(key);
    if (found == object.end()) fail(std::string(prefix) + key, "is missing");
    return *found;
  }
  std::string text(const json& value, const std::string& key) const {
    if (!value.is_string()) fail(key, "must be text");
    return value.get<std::string>();
  }
  float number(const json& value, const std::string& key) const {
    if (!value.is_number()) fail(key, "must be a number");
    const auto result = static_cast<float>(value.get<double>());
    if (!std::isfinite(result)) fail(key, "must be a finite number");
    return result;
  }
  /// Double: scenes may lie far from the origin of their files.
  glm::dvec3 position(const json& value, const std::string& key) const {
    numbers<3>(value, key);
    return {value[0].get<double>(), value[1].get<double>(), value[2].get<double>()};
  }
  template <std::size_t N>
  std::array<float, N> numbers(const json& value, const std::string& key) const {
    if (!value.is_array() || value.size() != N) fail(key, "must be a list of " + std::to_string(N) + " numbers");
    std::array<float, N> result;
    for (std::size_t i = 0; i < N; ++i) result[i] = number(value[i], key);
    return result;
  }
  [[noreturn]] void fail(const std::string& key, const std::string& problem) const {
    throw InputError(where_, label_ + ": " + key + " " + problem, kRemedy);
  }

  const json& episode_;
  const std::string& where_;
  std::string label_;
};

/// The keys of a set: its episodes, in sets split by scene where the files of the scenes are, and in generated sets what they were made
/// from.
struct ParsedSet {
  std::vector<Episode> episodes;
  std::string content_pattern;
  std::map<std::string, std::string> generator;
};

ParsedSet parse_text(std::string_view text, const std::string& where) {
  check_json_depth(text, where);
  check_no_nul(text, where);
  check_json_size(text, where, kEpisodeLimits);
  ParsedSet set;
  std::string key;
  bool has_list = false;
  std::optional<InputError> first_error;  // held until the version is known, which the file may state behind the episodes
  // Episodes are taken out of the parse as they end: a document of half a million of them would need gigabytes.
  const auto take = [&](int depth, json::parse_event_t event, json& parsed) {
    if (depth == 1 && event == json::parse_event_t::key) {
      key = parsed.get<std::string>();
      return key == "episodes" || key == kGeneratorKey || key == kVersionKey || key == "content_scenes_path";  // no other is kept
    } else if (depth == 1 && key == "episodes" && event == json::parse_event_t::array_end) {
      has_list = true;
    } else if (depth == 2 && key == "episodes") {
      if (first_error) return false;
      try {
        if (event == json::parse_event_t::object_end) {
          set.episodes.push_back(EpisodeReader(parsed, set.episodes.size(), where).read());
          return false;
        }
        if (event == json::parse_event_t::value || event == json::parse_event_t::array_end)
          throw InputError(where, "`episodes` contains an entry that is not an object", kRemedy);
      } catch (const InputError& error) {
        first_error = error;
        return false;
      }
    }
    return true;
  };
  json document;
  try {
    document = json::parse(text, take);
    check_schema_version(document, kVersionKey, where, "an episode set", {1, 1});
  } catch (const json::exception& error) {
    throw InputError(where, std::string("is not valid JSON: ") + error.what(), kRemedy);
  }
  if (first_error) throw *first_error;
  if (!document.is_object() || !has_list) throw InputError(where, "has no list `episodes`", kRemedy);
  if (const auto pattern = document.find("content_scenes_path"); pattern != document.end() && pattern->is_string())
    set.content_pattern = pattern->get<std::string>();
  if (const auto generator = document.find(kGeneratorKey); generator != document.end()) {
    if (!generator->is_object()) throw InputError(where, std::string(kGeneratorKey) + " must be an object", kRemedy);
    for (const auto& [name, value] : generator->items()) {
      if (!value.is_string()) throw InputError(where, std::string(kGeneratorKey) + "." + name + " must be text", kRemedy);
      set.generator.emplace(name, value.get<std::string>());
    }
  }
  return set;
}

ParsedSet parse_bytes(std::string_view bytes, const std::string& where) {
  if (!is_gzip(bytes)) return parse_text(bytes, where);
  const std::size_t most = std::min(kMaxTextBytes, std::max(kMinTextBytes, kMaxGrowth * bytes.size()));
  return parse_text(gunzip(bytes, where, most), where);
}

/// Files of a set that is split by scene, sorted by name: pattern has {data_path} (folder of the set) and {scene} (any name).
std::vector<std::filesystem::path> content_files(const std::filesystem::path& set_path, std::string pattern) {
  if (pattern.empty()) pattern = "{data_path}/content/{scene}.json.gz";
  if (const auto at = pattern.find("{data_path}"); at != std::string::npos)
    pattern.replace(at, std::string_view("{data_path}").size(), set_path.parent_path().empty() ? "." : set_path.parent_path().string());
  const std::filesystem::path full(pattern);
  const std::string name = full.filename().string();
  const auto at = name.find("{scene}");
  if (at == std::string::npos) return {full};
  const std::string before = name.substr(0, at), after = name.substr(at + std::string_view("{scene}").size());

  std::vector<std::filesystem::path> files;
  std::error_code ignored;  // a folder that is not there holds no files
  for (const auto& entry : std::filesystem::directory_iterator(full.parent_path(), ignored)) {
    const std::string file = entry.path().filename().string();
    if (file.size() > before.size() + after.size() && file.starts_with(before) && file.ends_with(after)) files.push_back(entry.path());
  }
  std::sort(files.begin(), files.end());
  return files;
}

json to_json(const Episode& episode) {
  const auto vector = [](glm::dvec3 v) { return json::array({v.x, v.y, v.z}); };
  json goals = json::array({{{"position", vector(episode.goal_position)}, {"radius", episode.goal_radius_m}}});
  for (const glm::dvec3 goal : episode.other_goals) goals.push_back({{"position", vector(goal)}});
  json out = {{"episode_id", episode.episode_id},
              {"scene_id", episode.scene_id},
              {"start_position", vector(episode.start_position)},
              {"start_rotation", episode.start_rotation},
              {"goals", std::move(goals)},
              {"info", {{"geodesic_distance", episode.geodesic_distance_m}, {"num_action", episode.num_action}, {"sound", episode.sound}}},
              {"start_room", nullptr},
              {"shortest_paths", nullptr}};
  // Only where there are any: sets without have the bytes of the AudioNav layout.
  for (const EpisodeSource& source : episode.sources) {
    json item = {{"position", vector(source.position)}, {"sound", source.sound}, {"onset_s", source.onset_s},
                 {"duration_s", source.duration_s},     {"loop", source.loop},   {"goal", source.goal},
                 {"level_db", source.level_db}};
    for (const Waypoint& at : source.path) item["path"].push_back({at.t_s, at.position.x, at.position.y, at.position.z});
    out["sources"].push_back(std::move(item));
  }
  if (episode.noise_snr_db) out["noise_snr_db"] = *episode.noise_snr_db;
  if (!episode.agent_sound.empty()) {
    out["agent_sound"] = episode.agent_sound;
    out["agent_level_db"] = episode.agent_level_db;
  }
  for (const EpisodeAgent& agent : episode.other_agents) {
    json item = {{"start_position", vector(agent.start_position)}, {"start_rotation", agent.start_rotation}};
    if (!agent.sound.empty()) {
      item["sound"] = agent.sound;
      item["level_db"] = agent.level_db;
    }
    out["agents"].push_back(std::move(item));
  }
  return out;
}

/// One episode per line: sets can be compared and cut with line tools.  Object keys are sorted, so the text is canonical.
std::string canonical_text(const std::vector<Episode>& episodes) {
  std::string text = "{\"episodes\":[";
  for (std::size_t i = 0; i < episodes.size(); ++i) {
    text += i == 0 ? "\n" : ",\n";
    text += json_text_of_any_bytes(to_json(episodes[i]));
  }
  return text + "\n]}\n";
}

EpisodeSet finish(ParsedSet set, const std::string& where) {
  if (set.episodes.empty()) throw InputError(where, "contains no episodes", kRemedy);
  const std::uint64_t hash = hash64(canonical_text(set.episodes));
  return {std::move(set.episodes), hash, std::move(set.generator)};
}

}  // namespace

EpisodeSet parse_episode_set(std::string_view json_or_gzip, const std::string& where) {
  return finish(parse_bytes(json_or_gzip, where), where);
}

bool is_split_set(std::string_view json_or_gzip, const std::string& where) { return parse_bytes(json_or_gzip, where).episodes.empty(); }

EpisodeSet load_episode_set(const std::filesystem::path& path) {
  ParsedSet set = parse_bytes(read_regular_file(path, kMaxTextBytes), path.string());
  if (set.episodes.empty())
    for (const auto& file : content_files(path, set.content_pattern)) {
      auto part = parse_bytes(read_regular_file(file, kMaxTextBytes), file.string()).episodes;
      std::move(part.begin(), part.end(), std::back_inserter(set.episodes));
    }
  return finish(std::move(set), path.string());
}

void save_episode_set(const EpisodeSet& set, const std::filesystem::path& path) {
  std::string text = canonical_text(set.episodes);
  if (!set.generator.empty()) {
    const std::string generator = json_text_of_any_bytes(json(set.generator));
    text.insert(1, "\"" + std::string(kGeneratorKey) + "\":" + generator + ",\n");
  }
  write_file_atomically(path, path.extension() == ".gz" ? gzip(text) : text);
}

std::string episode_set_text(const std::vector<Episode>& episodes) { return canonical_text(episodes); }

std::uint64_t episode_set_hash(const std::vector<Episode>& episodes) { return hash64(canonical_text(episodes)); }

}  // namespace earshot
