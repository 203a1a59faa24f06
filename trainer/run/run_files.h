#pragma once

#include <cstdint>
#include <filesystem>
#include <future>

#include "trainer/checkpoint/checkpoint.h"
#include "trainer/checkpoint/checkpoint_keeper.h"
#include "trainer/curves/event_log.h"
#include "trainer/run/run_config.h"

namespace earshot {

/// What the worker of rank 0 writes of a run: curves, metrics and checkpoints.  A full disk must not end a run that may find space again:
/// what cannot be written is logged, and the calls return how many writes failed.
class RunFiles {
 public:
  /// Removes what an earlier run has left half-written.  update: of the checkpoint or the state that the run goes on from, 0 for a new run.
  RunFiles(const RunConfig& config, std::uint64_t update);

  [[nodiscard]] std::uint64_t write_point(const CurvePoint& point);
  [[nodiscard]] std::filesystem::path checkpoint_of(std::uint64_t update, bool is_last) const;
  /// A periodic checkpoint goes to the disk in the background, and what of it failed is returned by the next call, or by finish().  That of
  /// the end is on disk when the call returns; throws RunError if it cannot be written.
  [[nodiscard]] std::uint64_t save(Checkpoint checkpoint, bool is_last);
  /// Waits for the checkpoint that is on its way.
  [[nodiscard]] std::uint64_t finish();

 private:
  /// What follows a checkpoint, whole or not.
  std::uint64_t write_beside(const std::filesystem::path& file, const Checkpoint& checkpoint, bool is_whole, bool is_last);

  const RunConfig& config_;
  const RunFolder folder_;
  EventLog events_;
  CheckpointKeeper checkpoints_;
  std::future<std::uint64_t> writing_;  ///< last: its destructor waits for the thread, which uses the others
};

}  // namespace earshot
