// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstddef>
#include <filesystem>
#include <memory>
#include <string>
#include <vector>

#include "evaluation/results/evaluator.h"

namespace earshot {

/// Starts `workers` copies of this program with these arguments, each of which evaluates its part (worker_part), and puts their results
/// together: the bytes of one process.  The first worker that fails ends the others, and its code comes back in exit_code (worker_group.h).
/// Call it before other threads exist.
/// checkpoint: what all of them are to evaluate, whatever its run writes meanwhile; null: a baseline.
EvaluationResult evaluate_with_workers(int workers, std::vector<std::string> arguments, const CheckpointBytes* checkpoint, int& exit_code);

/// Option that names the folder for a worker's result.
inline constexpr const char* kPartFolderOption = "--part-folder";

/// Runs one of these workers: evaluation.part selects the episodes, and threads become its part of the cores if all are requested.
/// The first worker shows the progress of all.  Throws InputError if this process is not a worker.
class EvaluationWorker {
 public:
  /// name: of the agent, for the progress.
  EvaluationWorker(std::filesystem::path folder, std::string name);
  ~EvaluationWorker();
  EvaluationWorker(const EvaluationWorker&) = delete;
  EvaluationWorker& operator=(const EvaluationWorker&) = delete;
  /// What evaluate_with_workers() was given.  Throws InputError.
  [[nodiscard]] CheckpointBytes checkpoint() const;
  /// num_episodes: of all workers.
  void prepare(EvaluationConfig& evaluation, std::size_t num_episodes);
  /// Leaves the result for the process that started the workers.
  void finish(const EvaluationResult& result);

 private:
  struct Impl;
  std::unique_ptr<Impl> impl_;
};

}  // namespace earshot
