// SPDX-License-Identifier: Apache-2.0
#include "trainer/checkpoint/checkpoint_keeper.h"

#include <unistd.h>

#include <cmath>
#include <string>
#include <system_error>

#include "sim/base/errors.h"
#include "trainer/checkpoint/find_checkpoint.h"

namespace earshot {

CheckpointKeeper::CheckpointKeeper(RunFolder folder, int keep, std::uint64_t resumed_update) : folder_(std::move(folder)), keep_(keep) {
  if (!std::filesystem::exists(folder_.best_checkpoint())) return;
  outdated_best_ = true;
  try {
    const CheckpointMetadata best = load_checkpoint_metadata(folder_.best_checkpoint());
    if (best.update > resumed_update || std::isnan(best.mean_reward)) return;
    best_reward_ = best.mean_reward;
    outdated_best_ = false;
  } catch (const InputError&) {  // damaged: replaced by the next one
  }
}

void CheckpointKeeper::saved(const std::filesystem::path& file, std::uint64_t update, double mean_reward, bool is_last) {
  if (!std::isnan(mean_reward) && (!best_reward_ || mean_reward > *best_reward_)) {
    name_best(file);
    best_reward_ = mean_reward;
  } else if (outdated_best_) {
    std::filesystem::remove(folder_.best_checkpoint());
  }
  outdated_best_ = false;
  folder_.remove_surplus(update, keep_, is_last);
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
