// SPDX-License-Identifier: Apache-2.0
#include "trainer/checkpoint/run_claim.h"

#include <fcntl.h>
#include <fmt/format.h>

#include "sim/base/errors.h"
#include "sim/base/file_descriptor.h"
#include "trainer/launch/launcher_job.h"

namespace earshot {
namespace {

constexpr const char* kLockHolder = "earshot train";

[[noreturn]] void fail_taken(const std::filesystem::path& folder, const std::string& claimant) {
  throw RunError(folder.string(), fmt::format("was taken over by {}; this run writes no more", claimant));
}

}  // namespace

void RunClaim::take() {
  writes_ = true;
  keep();
}

void RunClaim::give_up() {
  writes_ = false;
  if (!is_permanent_) lock_.reset();
}

void RunClaim::keep() {
  if (folder_.empty() || !writes_) return;
  if (lock_) {
    if (lock_->is_lost()) fail_taken(folder_, "another run, as its lease could not be renewed");
    return;
  }
  RunLockOptions options = run_lock_options(launcher_job());
  options.run = run_;
  lock_ = RunLock::try_acquire(folder_, kLockHolder, options);
  if (lock_) return;
  const Descriptor file(::open(RunFolder(folder_).lock_file().c_str(), O_RDONLY | O_CLOEXEC));
  const auto holder = file.get() < 0 ? std::nullopt : read_lock_record(file.get());
  // The writer before this one, lost but not yet ended, holds it for the run; so may one that has just begun to end.
  if (holder && !run_.empty() && holder->run != run_ && !is_known_gone(*holder)) fail_taken(folder_, holder->holder());
}

}  // namespace earshot
