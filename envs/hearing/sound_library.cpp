// SPDX-License-Identifier: Apache-2.0
#include "envs/hearing/sound_library.h"

#include <filesystem>

#include "sim/base/errors.h"

namespace earshot {

std::string resolve_sound(const std::string& name, const std::string& sound_root) {
  if (name.starts_with("synth:")) return name;
  const auto is_file = [](const std::filesystem::path& path) {
    std::error_code ignored;  // a name too long for a path is not a file
    return std::filesystem::is_regular_file(path, ignored);
  };
  for (const std::filesystem::path& base : {std::filesystem::path(sound_root) / name, std::filesystem::path(name)})
    for (const char* ending : {"", ".wav", ".flac", ".ogg"})
      if (const std::filesystem::path path = base.string() + ending; is_file(path)) return path.string();
  return name;
}

std::map<std::string, const Episode*> sounds_of(std::span<const Episode> episodes) {
  std::map<std::string, const Episode*> sounds;
  for (const Episode& episode : episodes) {
    if (episode.sources.empty()) sounds.emplace(episode.sound, &episode);
    for (const EpisodeSource& source : episode.sources) sounds.emplace(source.sound, &episode);
    if (!episode.agent_sound.empty()) sounds.emplace(episode.agent_sound, &episode);
    for (const EpisodeAgent& agent : episode.other_agents)
      if (!agent.sound.empty()) sounds.emplace(agent.sound, &episode);
  }
  return sounds;
}

SoundLibrary::SoundLibrary(std::span<const Episode> episodes, const std::string& sound_root, float sample_rate_hz, float gain) {
  for (const auto& [name, episode] : sounds_of(episodes)) {
    SoundClip clip;
    try {
      clip = open_sound(resolve_sound(name, sound_root), sample_rate_hz);
    } catch (const InputError& error) {
      throw InputError("sound '" + name + "' of episode '" + episode->episode_id + "' in " + episode->scene_id, error.what(),
                       "set sound_root to the folder of the sounds");
    }
    for (float& sample : clip.samples) sample *= gain;
    sounds_.emplace(name, std::move(clip));
  }
}

}  // namespace earshot
