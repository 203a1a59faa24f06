// SPDX-License-Identifier: Apache-2.0
#include "trainer/checkpoint/checkpoint_keeper.h"

#include <unistd.h>

#include <cmath>
#include <string>
#include <system_error>

#include "sim/base/errors.h"

namespace earshot {
namespace {

/// Whether a held-out evaluation has found this checkpoint to be the best one.
bool is_best_evaluated(const CheckpointMetadata& metadata) {
  return metadata.held_out && metadata.held_out->best_update > 0 && metadata.held_out->best_update == metadata.update;
}

}  // namespace

CheckpointKeeper::CheckpointKeeper(RunFolder folder, int keep, std::uint64_t resumed_update) : folder_(std::move(folder)), keep_(keep) {
  if (!std::filesystem::exists(folder_.best_checkpoint())) return;
  outdated_best_ = true;
  try {
    const CheckpointMetadata best = load_checkpoint_metadata(folder_.best_checkpoint());
    if (best.update > resumed_update || (std::isnan(best.mean_reward) && !is_best_evaluated(best))) return;
    if (!std::isnan(best.mean_reward)) best_reward_ = best.mean_reward;
    outdated_best_ = false;
  } catch (const InputError&) {  // damaged: replaced by the next one
  }
}

bool CheckpointKeeper::is_best(const CheckpointMetadata& metadata) const {
  if (metadata.held_out) return is_best_evaluated(metadata);
  return !std::isnan(metadata.mean_reward) && (!best_reward_ || metadata.mean_reward > *best_reward_);
}

void CheckpointKeeper::saved(const std::filesystem::path& file, const CheckpointMetadata& metadata, bool is_last) {
  if (is_best(metadata)) {
    name_best(file);
    if (!std::isnan(metadata.mean_reward)) best_reward_ = metadata.mean_reward;
  } else if (outdated_best_) {
    std::filesystem::remove(folder_.best_checkpoint());
    // The one that the evaluations before had found, where it is among those that stayed.
    const std::uint64_t update = metadata.held_out ? metadata.held_out->best_update : 0;
    if (update > 0 && std::filesystem::exists(folder_.checkpoint_of(update))) name_best(folder_.checkpoint_of(update));
  }
  outdated_best_ = false;
  folder_.remove_surplus(metadata.update, keep_, is_last);
}

void CheckpointKeeper::name_best(const std::filesystem::path& file) const {
  const std::filesystem::path best = folder_.best_checkpoint();
  const std::filesystem::path temporary = best.string() + ".tmp" + std::to_string(::getpid());
  std::filesystem::remove(temporary);
  std::error_code no_links;
  std::filesystem::create_hard_link(file, temporary, no_links);
  if (no_links) std::filesystem::copy_file(file, temporary);
  std::filesystem::rename(temporary, best);
}

}  // namespace earshot
