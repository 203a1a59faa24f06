// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <filesystem>
#include <memory>
#include <string>

#include "trainer/checkpoint/run_lock.h"

namespace earshot {

/// One worker's claim on the lock of its run folder.  The lock belongs to the run: the process that writes its files holds it, unless
/// all workers hold it together, as those do that one process has started.
class RunClaim {
 public:
  RunClaim() = default;
  /// lock: held or inherited by this process; null without one.  run: RunLock::run, the same on all workers.  is_permanent:
  /// whether `lock` is held whatever this worker's rank.
  RunClaim(std::filesystem::path folder, std::shared_ptr<RunLock> lock, std::string run, bool is_permanent)
      : folder_(std::move(folder)), lock_(std::move(lock)), run_(std::move(run)), is_permanent_(is_permanent) {}

  /// Of the worker that writes from here on.  Where the writer before it stands still and holds the lock yet, keep() tries again.  Throws
  /// RunError where another run has the folder.
  void take();
  /// For a worker that stops writing because a lower rank has returned.
  void give_up();
  /// At each update of the worker that writes: throws RunError where another run has taken the folder.
  void keep();

  [[nodiscard]] bool is_held() const { return lock_ != nullptr; }

 private:
  std::filesystem::path folder_;
  std::shared_ptr<RunLock> lock_;
  std::string run_;
  bool is_permanent_ = false, writes_ = false;
};

}  // namespace earshot
