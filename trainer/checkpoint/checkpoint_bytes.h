// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstddef>
#include <cstdint>
#include <filesystem>
#include <optional>
#include <string>

#include "trainer/checkpoint/find_checkpoint.h"

namespace earshot {

/// A checkpoint as it was at one moment: a run that writes another one in its place changes nothing.
struct CheckpointBytes {
  std::filesystem::path path;
  std::string bytes;
};

/// find_checkpoint() and the whole file, again where the run has removed it in between.  Throws InputError: none, or all are larger.
CheckpointBytes read_checkpoint(const std::filesystem::path& folder_or_file, std::size_t max_bytes = kMaxCheckpointBytes);

/// load_checkpoint_metadata() of what was read.
CheckpointMetadata metadata_of(const CheckpointBytes& checkpoint);

/// EpisodeSet::hash of the set that the environments of a checkpoint were in; nullopt for a policy file, which has none.  Throws
/// InputError.
std::optional<std::uint64_t> episode_set_of(const CheckpointBytes& checkpoint);

}  // namespace earshot
