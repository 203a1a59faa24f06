// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstddef>
#include <cstdint>
#include <filesystem>
#include <optional>
#include <string>

#include "trainer/held_out/held_out_state.h"

namespace earshot {

/// Header of a checkpoint, without its tensors.
struct CheckpointMetadata {
  std::string config_yaml;   ///< every key of the run's config with its value, config_text()
  std::string architecture;  ///< PolicyNetworkImpl::architecture()
  std::uint64_t update = 0, env_steps = 0;
  std::uint64_t seed = 0;
  int world_size = 1;
  std::string engine, engine_commit;          ///< engine_hash() and engine_commit() of the program that wrote it
  double elapsed_s = 0;                       ///< wall seconds of training, over all sittings; 0 in files without this field
  double mean_reward = 0;                     ///< per episode, over the last episodes; NaN where none had finished
  std::optional<HeldOutState> held_out = {};  ///< of a run that evaluates itself
  bool is_policy = false;                     ///< the file holds no state of a training, so no run can resume from it
};

/// Largest file that is read as a checkpoint.
inline constexpr std::size_t kMaxCheckpointBytes = std::size_t{4} << 30;

/// Reads the whole file and checks its hash; no tensor is made.  Throws InputError as load_checkpoint does, and for a larger file.
CheckpointMetadata load_checkpoint_metadata(const std::filesystem::path& path, std::size_t max_bytes = kMaxCheckpointBytes);

/// The newest checkpoint under a run folder, or the file itself.  Damaged and larger ones in a folder are skipped with a warning.  Throws
/// InputError if none is complete.
std::filesystem::path find_checkpoint(const std::filesystem::path& folder_or_file, std::size_t max_bytes = kMaxCheckpointBytes);

}  // namespace earshot
