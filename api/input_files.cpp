// SPDX-License-Identifier: Apache-2.0
#include "api/input_files.h"

#include <fmt/format.h>
#include <sys/stat.h>

#include <set>
#include <string_view>
#include <utility>

#include "earshot/source.h"
#include "envs/hearing/heard_files.h"
#include "envs/hearing/sound_library.h"
#include "envs/scenes/scene_cache.h"
#include "sim/base/errors.h"
#include "sim/base/files.h"
#include "sim/scene/scene.h"
#include "sim/scene/scene_inputs.h"

namespace earshot::api {
namespace {

/// By the time of its last change of any kind, which no program can set.
void require_unchanged(const std::filesystem::path& file, timespec since) {
  struct stat found {};
  if (stat(file.c_str(), &found) != 0) return;  // whoever reads it says so
  const timespec& changed = found.st_ctim;
  if (std::pair(changed.tv_sec, changed.tv_nsec) > std::pair(since.tv_sec, since.tv_nsec))
    throw InputError(file.string(), "has changed since the environments were made", "make them again");
}

/// Of the files that load_scene(spec) reads; 0 where it cannot read them, as episodes there are quarantined.
std::uint64_t hash_of_scene(const std::string& spec) {
  if (const auto hash = hash_of_scene_inputs(spec)) return *hash;
  try {
    return load_scene(spec).hash();  // names of its files have escapes
  } catch (const InputError&) {
    return 0;
  }
}

InputFile sound_file_of(const std::string& name, const std::string& path, timespec since) {
  require_unchanged(path, since);
  return {name, hash_of_file(path)};
}

}  // namespace

std::vector<InputFile> files_of_channels(const std::string& channels) {
  std::vector<InputFile> files;
  for (const std::filesystem::path& file : ListenerLayout::named(channels).files) files.push_back({file.string(), hash_of_file(file)});
  return files;
}

std::string state_of_files(const ListenerLayout& layout, const std::string& hrtf) {
  std::string state;
  for (const std::filesystem::path& file : layout.files) state += fmt::format("{} {:x}\n", file.string(), hash_of_file(file));
  struct stat found {};
  if (!hrtf.empty() && stat(hrtf.c_str(), &found) == 0)
    state += fmt::format("{} {} {} {}.{:09} {}.{:09}\n", found.st_dev, found.st_ino, found.st_size, found.st_mtim.tv_sec,
                         found.st_mtim.tv_nsec, found.st_ctim.tv_sec, found.st_ctim.tv_nsec);
  return state;
}

timespec file_time_now() {
  timespec now{};
  clock_gettime(CLOCK_REALTIME, &now);
  return now;
}

std::vector<InputFile> input_files_of(const EnvConfig& config, const earshot::EpisodeSet& set, timespec since) {
  std::set<std::string> scenes;
  for (const earshot::Episode& episode : set.episodes) scenes.insert(episode.scene_id);
  std::vector<InputFile> files;
  for (const std::string& scene : scenes) {
    const std::string spec = resolve_scene(scene, config.scene_root);
    const auto read = files_of_scene(spec);
    if (read && read->empty()) continue;  // it is generated
    for (const std::string& file : read.value_or(std::vector<std::string>())) require_unchanged(file, since);
    files.push_back({scene, hash_of_scene(spec)});
  }
  for (const auto& [sound, of] : sounds_of(set.episodes))
    if (!sound.starts_with("synth:")) files.push_back(sound_file_of(sound, resolve_sound(sound, config.sound_root), since));
  if (!config.hrtf.empty()) files.push_back(sound_file_of(config.hrtf, config.hrtf, since));
  const ListenerLayout layout = config.observation.layout();
  for (const std::filesystem::path& file : layout.files) files.push_back(sound_file_of(file.string(), file.string(), since));
  return files;
}

}  // namespace earshot::api
