#pragma once

#include <cstdint>
#include <filesystem>
#include <string>

namespace earshot {

/// What a checkpoint says about itself, without its tensors.
struct CheckpointMetadata {
  std::string config_yaml;   ///< the whole run config as it was resolved
  std::string architecture;  ///< ActorCritic::architecture()
  std::uint64_t update = 0, env_steps = 0;
  std::uint64_t seed = 0;
  int world_size = 1;
};

/// Reads the whole file and checks its hash; no tensor is made.  Throws InputError as load_checkpoint does.
CheckpointMetadata load_checkpoint_metadata(const std::filesystem::path& path);

/// The newest checkpoint under a run folder, or the file itself.  Damaged ones in a folder are skipped with a warning.  Throws InputError
/// if there is none that is whole.
std::filesystem::path find_checkpoint(const std::filesystem::path& folder_or_file);

}  // namespace earshot
