// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <chrono>
#include <filesystem>
#include <memory>
#include <optional>
#include <string>

#include "trainer/checkpoint/lease_file.h"
#include "trainer/checkpoint/lock_record.h"
#include "trainer/checkpoint/run_folder.h"

namespace earshot {

struct RunLockOptions {
  enum class Kind {
    by_file_system,  ///< a lease where other hosts can see the folder
    kernel,
    lease
  };
  Kind kind = Kind::by_file_system;
  std::chrono::milliseconds lease{30000};  ///< a holder that has not renewed for so long is gone
  std::chrono::milliseconds grace{15000};  ///< time that killed processes take to end
  std::string job = {};                    ///< of the launcher: a holder of the same job is waited for, as this is its restart
  std::string run = {};                    ///< of which this one is the next holder, so that it need not wait for a lease; empty: a new run
};

/// The lock on the folder of one run: `run.lock` in it, held by the writing process for the whole run, and released with its holder.
///
/// On a local disk a lock of the kernel (of the open file description, fcntl F_OFD_SETLK): it ends when the last process ends that has the
/// descriptor, so that workers to whom it is handed hold it too.  On a shared file system a lease (lease_file.h).  The file names the
/// holder; it is removed at an orderly end.
class RunLock {
 public:
  /// Makes the folder where it is missing, and removes at the end what it made and is empty.  command: "earshot train".  A holder that is
  /// being killed is waited for up to `grace`, one of the same job up to `lease` + `grace`.  Throws InputError that names process, host and
  /// start of another holder, at once; or the folder, where it cannot be written.
  static std::shared_ptr<RunLock> acquire(const std::filesystem::path& folder, const std::string& command,
                                          const RunLockOptions& options = {});
  /// The same, but null where another holder has it.
  static std::shared_ptr<RunLock> try_acquire(const std::filesystem::path& folder, const std::string& command,
                                              const RunLockOptions& options = {});
  /// The lock that spawn_workers() passed to this process for that folder; null without one.
  static std::shared_ptr<RunLock> inherited(const std::filesystem::path& folder);
  ~RunLock();
  RunLock(const RunLock&) = delete;
  RunLock& operator=(const RunLock&) = delete;

  /// For a process that is to hold it too, and its variable for that; without a descriptor -1 and the variable alone.
  [[nodiscard]] int descriptor() const { return descriptor_; }
  [[nodiscard]] std::string variable() const;
  [[nodiscard]] const std::string& run() const { return run_; }
  /// A lease that was not renewed in time, and that another run has by now.
  [[nodiscard]] bool is_lost() const { return lease_ && lease_->is_lost(); }

 private:
  RunLock() = default;
  bool try_kernel(const LockRecord& record, const RunLockOptions& options);
  bool try_once(const LockRecord& record, const RunLockOptions& options);

  std::filesystem::path folder_, file_;
  std::vector<std::filesystem::path> made_;  ///< folders, the innermost last
  std::string run_;
  int descriptor_ = -1;
  bool is_inherited_ = false;
  std::unique_ptr<LeaseFile> lease_;
};

/// What RunLock::acquire does where EARSHOT_RUN_LOCK_KIND is "kernel" or "lease", for file systems that do not say what they are; else by
/// the file system.  job: see RunLockOptions.
RunLockOptions run_lock_options(const std::string& job);

/// The run folder that a file written to `path` would lie in: its folder, or that of checkpoints/, where a run is or is under way; nullopt
/// where neither is one.
std::optional<std::filesystem::path> run_folder_around(const std::filesystem::path& path);

}  // namespace earshot
