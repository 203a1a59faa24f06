// SPDX-License-Identifier: Apache-2.0
#include "evaluation/results/set_digest.h"

#include <fmt/format.h>

#include <set>
#include <string_view>

#include "envs/hearing/sound_library.h"
#include "envs/scenes/scene_cache.h"
#include "sim/base/errors.h"
#include "sim/base/regular_file.h"
#include "sim/base/sha256.h"
#include "sim/scene/scene_inputs.h"

namespace earshot {
namespace {

constexpr std::size_t kMaxBytes = std::size_t{4} << 30;

std::set<std::string> sounds_named_by(const EpisodeSet& set) {
  std::set<std::string> sounds;
  const auto add = [&](const std::string& sound) {
    if (!sound.empty() && !sound.starts_with("synth:")) sounds.insert(sound);
  };
  for (const Episode& episode : set.episodes) {
    add(episode.sound);
    add(episode.agent_sound);
    for (const EpisodeSource& source : episode.sources) add(source.sound);
    for (const EpisodeAgent& agent : episode.other_agents) add(agent.sound);
  }
  return sounds;
}

/// A line for every file of scenes and sounds: its name, and the SHA-256 of its bytes.
std::string content_lines(const EpisodeSet& set, const std::string& scene_root, const std::string& sound_root) {
  std::set<std::string> scenes;
  for (const Episode& episode : set.episodes) scenes.insert(episode.scene_id);
  std::string lines;
  for (const std::string& scene : scenes) {
    const std::filesystem::path found = resolve_scene(scene, scene_root);
    const auto files = files_of_scene(found.string());
    if (!files)
      throw InputError(scene, "is missing, or which files it reads cannot be told", "check the path, and use plain names without escapes");
    for (const std::filesystem::path file : *files)
      lines += fmt::format("scene {} {} {}\n", scene, file.lexically_relative(found.parent_path()).string(),
                           sha256_hex(read_regular_file(file, kMaxBytes)));
  }
  for (const std::string& sound : sounds_named_by(set))
    lines += fmt::format("sound {} {}\n", sound, sha256_hex(read_regular_file(resolve_sound(sound, sound_root), kMaxBytes)));
  return lines;
}

}  // namespace

std::string digest_of_set(const std::filesystem::path& file, const std::string& scene_root, const std::string& sound_root) {
  const EpisodeSet set = load_episode_set(file);
  const std::string bytes = read_regular_file(file, kMaxBytes), lines = content_lines(set, scene_root, sound_root);
  if (lines.empty() && !is_split_set(bytes, file.string())) return sha256_hex(bytes);
  return sha256_hex(episode_set_text(set.episodes) + lines);
}

std::string digest_of_content(const EpisodeSet& set, const std::string& scene_root, const std::string& sound_root) {
  const std::string lines = content_lines(set, scene_root, sound_root);
  return lines.empty() ? std::string() : sha256_hex(lines);
}

}  // namespace earshot
