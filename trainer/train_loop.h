#pragma once

#include <filesystem>
#include <string>

#include "trainer/collective.h"
#include "trainer/run_config.h"

namespace earshot {

/// What a finished run reports.
struct TrainReport {
  std::uint64_t updates = 0, env_steps = 0;
  double wall_s = 0, steps_per_s = 0;
  std::filesystem::path checkpoint;   ///< the last one
};

/// One worker's part of a DD-PPO run: roll out, average gradients, step, until config.total_steps or config.max_minutes.  Rank 0 writes curves
/// (events.jsonl, TensorBoard) and checkpoints under config.out and shows progress.  SIGTERM, SIGINT and SIGUSR1 end the run after the
/// current update with a checkpoint.  resume: a checkpoint file, or empty to start anew; a resumed run gives the bits of the unbroken one.
/// config_yaml: the resolved text that checkpoints carry.
TrainReport train(const RunConfig& config, const std::string& config_yaml, Collective& collective, const std::filesystem::path& resume);

/// The newest checkpoint under a run folder, or the file itself.  Throws InputError if there is none.
std::filesystem::path find_checkpoint(const std::filesystem::path& folder_or_file);

}  // namespace earshot
