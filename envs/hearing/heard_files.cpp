// SPDX-License-Identifier: Apache-2.0
#include "envs/hearing/heard_files.h"

#include <cstddef>
#include <filesystem>

#include "envs/hearing/sound_library.h"
#include "sim/base/files.h"
#include "sim/base/regular_file.h"

namespace earshot {
namespace {

constexpr std::size_t kMaxBytes = std::size_t{4} << 30;

std::uint64_t hash_of_file(const std::filesystem::path& path) { return hash64(read_regular_file(path, kMaxBytes)); }

}  // namespace

HeardFiles heard_files_of(const EnvConfig& config, std::span<const Episode> episodes) {
  HeardFiles files;
  if (!config.observation.hears()) return files;
  for (const auto& [name, of] : sounds_of(episodes))
    if (!name.starts_with("synth:")) files[name] = hash_of_file(resolve_sound(name, config.sound_root));
  if (!config.hrtf.empty()) files[config.hrtf] = hash_of_file(config.hrtf);
  for (const std::filesystem::path& file : config.observation.layout().files) files[file.string()] = hash_of_file(file);
  return files;
}

}  // namespace earshot
