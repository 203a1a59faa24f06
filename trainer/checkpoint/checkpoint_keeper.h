// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <filesystem>
#include <optional>

#include "trainer/checkpoint/find_checkpoint.h"
#include "trainer/checkpoint/run_folder.h"

namespace earshot {

/// Bounds the checkpoints of one run: the `keep` newest periodic ones stay, the best, and that of the end.  One of rank 0.
///
/// The best is the one with the highest mean reward per episode over the last episodes (about 200, EpisodeWindow) when it was saved; of a
/// run that evaluates itself the best_update of its HeldOutState.  best.ckpt is another name of that file (a hard link, or a copy if the
/// file system lacks links), so that it outlives the bound.
class CheckpointKeeper {
 public:
  /// resumed_update: of the checkpoint that the run goes on from, 0 for a new run; a best.ckpt of a later update does not count.
  CheckpointKeeper(RunFolder folder, int keep, std::uint64_t resumed_update);

  /// Call once `file`, a checkpoint with this metadata, is whole on disk: nothing is removed before.  metadata.mean_reward: NaN where no
  /// episode has finished.  Throws std::filesystem::filesystem_error.
  void saved(const std::filesystem::path& file, const CheckpointMetadata& metadata, bool is_last);

 private:
  [[nodiscard]] bool is_best(const CheckpointMetadata& metadata) const;
  void name_best(const std::filesystem::path& file) const;

  RunFolder folder_;
  int keep_;
  std::optional<double> best_reward_;
  bool outdated_best_ = false;  // best.ckpt is there and is not of this run's past
};

}  // namespace earshot
