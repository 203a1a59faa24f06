// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <chrono>
#include <cstdint>
#include <filesystem>
#include <functional>
#include <future>

#include "trainer/checkpoint/checkpoint.h"
#include "trainer/checkpoint/checkpoint_keeper.h"
#include "trainer/curves/event_log.h"
#include "trainer/run/run_config.h"

namespace earshot {

/// How a checkpoint comes to a disk that may be full.
struct DiskPatience {
  std::chrono::milliseconds last{600000};  ///< how long the last checkpoint of a run waits for room
  std::chrono::milliseconds look{1000};    ///< between two tries
};

/// Files that the worker of rank 0 writes: curves, metrics and checkpoints.  A full disk must not end a run that may find space again:
/// a failed write is logged, and the calls return the number of failed writes.
///
/// Where a checkpoint finds the disk full, the oldest periodic ones go, one by one, until it has room; the newest that is whole stays in
/// any case.
class RunFiles {
 public:
  using Write = std::function<void(const Checkpoint& checkpoint, const std::filesystem::path& file)>;

  /// Removes what an earlier run has left half-written.  update: of the checkpoint or the state that the run goes on from, 0 for a new run.
  /// write: function that writes a checkpoint, for tests.  evaluated_update: of the last evaluation of that state.
  RunFiles(const RunConfig& config, std::uint64_t update, DiskPatience patience = {}, Write write = save_checkpoint,
           std::uint64_t evaluated_update = kAllEvaluations);

  [[nodiscard]] std::uint64_t write_point(const CurvePoint& point);
  [[nodiscard]] std::filesystem::path checkpoint_of(std::uint64_t update, bool is_last) const;
  /// A periodic checkpoint goes to the disk in the background, and what of it failed is returned by the next call, or by finish().  That of
  /// the end is on disk when the call returns: it waits for room as long as `patience` allows, says so once, and calls waits() at each try;
  /// throws RunError if it cannot be written.
  [[nodiscard]] std::uint64_t save(Checkpoint checkpoint, bool is_last, const std::function<void()>& waits = {});
  /// Waits for the checkpoint that is on its way.
  [[nodiscard]] std::uint64_t finish();
  /// Whether the last periodic checkpoint has failed, and should be tried again.  Waits for nothing.
  [[nodiscard]] bool owes_checkpoint();
  /// The newest update that these calls have put on the disk, that it began with if none; after finish().
  [[nodiscard]] std::uint64_t saved_update() const { return saved_update_; }

 private:
  /// Throws RunError.
  void write_making_room(const std::filesystem::path& file, const Checkpoint& checkpoint);
  void write_last(const std::filesystem::path& file, const Checkpoint& checkpoint, const std::function<void()>& waits);
  /// Work after a checkpoint, complete or not.
  std::uint64_t write_beside(const std::filesystem::path& file, const Checkpoint& checkpoint, bool is_whole, bool is_last);

  const RunConfig& config_;
  const DiskPatience patience_;
  const Write write_;
  const RunFolder folder_;
  EventLog events_;
  CurvePoint last_update_, last_evaluation_;  ///< of the points that were written
  CheckpointKeeper checkpoints_;
  std::uint64_t saved_update_, failed_before_ = 0;  ///< the second: found by owes_checkpoint(), not returned yet
  bool owes_checkpoint_ = false;
  std::future<std::uint64_t> writing_;  ///< last: its destructor waits for the thread, which uses the others
};

}  // namespace earshot
