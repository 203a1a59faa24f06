// SPDX-License-Identifier: Apache-2.0
#include "envs/hearing/heard_files.h"

#include <cstddef>

#include "envs/hearing/sound_library.h"
#include "sim/base/files.h"
#include "sim/base/regular_file.h"

namespace earshot {

std::uint64_t hash_of_file(const std::filesystem::path& path) {
  constexpr std::size_t kMaxBytes = std::size_t{4} << 30;
  return hash64(read_regular_file(path, kMaxBytes));
}

HeardFiles heard_files_of(const EnvConfig& config, std::span<const Episode> episodes) {
  HeardFiles files;
  if (!config.observation.hears()) return files;
  for (const auto& [name, of] : sounds_of(episodes))
    if (!name.starts_with("synth:")) files.sounds[name] = hash_of_file(resolve_sound(name, config.sound_root));
  if (!config.hrtf.empty()) files.ears[config.hrtf] = hash_of_file(config.hrtf);
  for (const std::filesystem::path& file : config.observation.layout().files) files.ears[file.string()] = hash_of_file(file);
  return files;
}

FileHashes heard_in(const Episode& episode, const HeardFiles& files) {
  FileHashes heard = files.ears;
  for (const auto& [name, of] : sounds_of(std::span(&episode, 1)))
    if (const auto found = files.sounds.find(name); found != files.sounds.end()) heard.insert(*found);
  return heard;
}

FileHashes heard_in_all(const HeardFiles& files) {
  FileHashes heard = files.ears;
  heard.insert(files.sounds.begin(), files.sounds.end());
  return heard;
}

}  // namespace earshot
