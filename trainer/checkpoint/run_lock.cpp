// SPDX-License-Identifier: Apache-2.0
#include "trainer/checkpoint/run_lock.h"

#include <fcntl.h>
#include <fmt/format.h>
#include <sys/file.h>
#include <sys/stat.h>
#include <unistd.h>

#include <cerrno>
#include <cstdlib>
#include <sstream>
#include <system_error>
#include <thread>
#include <utility>
#include <vector>

#include "sim/base/errors.h"
#include "sim/base/file_descriptor.h"
#include "sim/base/text/log.h"

namespace earshot {
namespace {

using Clock = std::chrono::steady_clock;

constexpr std::chrono::milliseconds kBetweenTries(50);
constexpr const char *kVariable = "EARSHOT_RUN_LOCK", *kKindVariable = "EARSHOT_RUN_LOCK_KIND";

enum class KernelLock { taken, held, unknown };

/// Of the open file description; by flock where the kernel does not know those.
KernelLock lock_description(int descriptor) {
  struct flock whole {};
  whole.l_type = F_WRLCK;
  whole.l_whence = SEEK_SET;
  if (::fcntl(descriptor, F_OFD_SETLK, &whole) == 0) return KernelLock::taken;
  if (errno == EAGAIN || errno == EACCES) return KernelLock::held;
  if (errno != EINVAL) return KernelLock::unknown;
  if (::flock(descriptor, LOCK_EX | LOCK_NB) == 0) return KernelLock::taken;
  return errno == EWOULDBLOCK ? KernelLock::held : KernelLock::unknown;
}

/// The holder before removes the file at its end, and a lock on a removed one excludes no other process.
bool is_file_at(const std::filesystem::path& path, int descriptor) {
  struct stat held {
  }, named{};
  return ::fstat(descriptor, &held) == 0 && ::stat(path.c_str(), &named) == 0 && held.st_dev == named.st_dev && held.st_ino == named.st_ino;
}

std::optional<LockRecord> record_in(const std::filesystem::path& file) {
  const Descriptor descriptor(::open(file.c_str(), O_RDONLY | O_CLOEXEC));
  return descriptor.get() < 0 ? std::nullopt : read_lock_record(descriptor.get());
}

/// Those that were not there before, the innermost last.
std::vector<std::filesystem::path> make_folders(const std::filesystem::path& folder) {
  std::vector<std::filesystem::path> missing;
  std::error_code error;
  for (auto path = std::filesystem::absolute(folder); !path.empty() && !std::filesystem::exists(path, error); path = path.parent_path())
    missing.insert(missing.begin(), path);
  std::filesystem::create_directories(folder, error);
  if (error || !std::filesystem::is_directory(folder, error))
    throw InputError(folder.string(), error ? "cannot be created: " + error.message() : "is not a folder",
                     "name another folder, one that can be written");
  return missing;
}

/// How long a holder is waited for, and what for.
struct Patience {
  std::chrono::milliseconds limit{0};
  const char* why = nullptr;
};
Patience patience_with(const std::optional<LockRecord>& holder, const RunLockOptions& options) {
  if (holder && !options.job.empty() && holder->job == options.job)
    return {options.lease + options.grace, "of the same job, which this one restarts"};
  if (!holder || is_known_gone(*holder)) return {options.grace, nullptr};
  return {};
}

InputError refusal(const std::filesystem::path& folder, const std::filesystem::path& file, const std::optional<LockRecord>& holder) {
  const std::string holder_text = holder ? holder->holder() : std::string("another process, which has not said its name");
  return {folder.string(), "is in use by " + holder_text,
          fmt::format("wait for its end, or name another folder; if that process is gone, remove {}", file.string())};
}

}  // namespace

bool RunLock::try_kernel(const LockRecord& record, const RunLockOptions& options) {
  Descriptor descriptor(::open(file_.c_str(), O_RDWR | O_CREAT | O_CLOEXEC, 0666));
  if (descriptor.get() < 0) throw InputError(file_.string(), "cannot be created: " + last_error(), "name a folder that can be written");
  const KernelLock outcome = lock_description(descriptor.get());
  if (outcome == KernelLock::unknown)
    throw InputError(file_.string(), "cannot be locked: " + last_error(), fmt::format("set {}=lease", kKindVariable));
  if (outcome == KernelLock::held || !is_file_at(file_, descriptor.get())) return false;
  // A holder on another host that sees this disk as a shared one.
  const auto former = read_lock_record(descriptor.get());
  if (former && former->is_lease && former->run != record.run && !is_old_lease(file_, options.lease)) return false;
  const std::string text = encode_lock_record(record);
  // Where the disk is full the lock holds without a name.
  if (::ftruncate(descriptor.get(), 0) == 0) static_cast<void>(::pwrite(descriptor.get(), text.data(), text.size(), 0) < 0);
  descriptor_ = ::fcntl(descriptor.get(), F_DUPFD_CLOEXEC, 3);
  if (descriptor_ < 0) throw RunError(file_.string(), "cannot be kept open: " + last_error());
  return true;
}

bool RunLock::try_once(const LockRecord& record, const RunLockOptions& options) {
  if (!record.is_lease) return try_kernel(record, options);
  lease_ = LeaseFile::try_take(file_, record, options.lease);
  return lease_ != nullptr;
}

std::shared_ptr<RunLock> RunLock::try_acquire(const std::filesystem::path& folder, const std::string& command,
                                              const RunLockOptions& options) {
  std::shared_ptr<RunLock> lock(new RunLock);
  lock->folder_ = folder;
  lock->file_ = RunFolder(folder).lock_file();
  lock->made_ = make_folders(folder);
  LockRecord record = own_lock_record(command, options.job, options.run);
  using Kind = RunLockOptions::Kind;
  record.is_lease = options.kind == Kind::lease || (options.kind == Kind::by_file_system && is_shared_file_system(folder));
  lock->run_ = record.run;
  return lock->try_once(record, options) ? lock : nullptr;
}

std::shared_ptr<RunLock> RunLock::acquire(const std::filesystem::path& folder, const std::string& command, const RunLockOptions& options) {
  const auto began = Clock::now();
  for (bool has_logged = false;;) {
    if (auto lock = try_acquire(folder, command, options)) return lock;
    const std::filesystem::path file = RunFolder(folder).lock_file();
    const auto holder = record_in(file);
    const Patience patience = patience_with(holder, options);
    if (Clock::now() - began >= patience.limit) throw refusal(folder, file, holder);
    if (patience.why != nullptr && !std::exchange(has_logged, true))
      log_info(fmt::format("{}: waits for {} {}", folder.string(), holder->holder(), patience.why));
    std::this_thread::sleep_for(kBetweenTries);
  }
}

std::shared_ptr<RunLock> RunLock::inherited(const std::filesystem::path& folder) {
  const char* text = std::getenv(kVariable);
  int descriptor = -1;
  std::string run;
  if (text == nullptr || !(std::istringstream(text) >> descriptor >> run)) return nullptr;
  std::shared_ptr<RunLock> lock(new RunLock);
  lock->folder_ = folder;
  lock->file_ = RunFolder(folder).lock_file();
  lock->is_inherited_ = true;
  lock->run_ = run;
  if (descriptor >= 0) {
    if (!is_file_at(lock->file_, descriptor)) return nullptr;  // a number that is left over from elsewhere
    ::fcntl(descriptor, F_SETFD, FD_CLOEXEC);
    lock->descriptor_ = descriptor;
  } else if (const auto holder = record_in(lock->file_); !holder || holder->run != run) {
    return nullptr;
  }
  return lock;
}

std::string RunLock::variable() const { return fmt::format("{}={} {}", kVariable, descriptor_, run_); }

RunLock::~RunLock() {
  lease_.reset();
  if (descriptor_ >= 0) {
    if (!is_inherited_ && is_file_at(file_, descriptor_)) ::unlink(file_.c_str());
    ::close(descriptor_);
  }
  for (auto folder = made_.rbegin(); folder != made_.rend(); ++folder)
    if (::rmdir(folder->c_str()) != 0) break;  // it holds something
}

RunLockOptions run_lock_options(const std::string& job) {
  RunLockOptions options{.job = job};
  const char* text = std::getenv(kKindVariable);
  if (text == nullptr || *text == '\0') return options;
  const std::string kind = text;
  if (kind != "kernel" && kind != "lease")
    throw InputError(fmt::format("{} = {}", kKindVariable, kind), "is neither kernel nor lease", "unset it");
  options.kind = kind == "lease" ? RunLockOptions::Kind::lease : RunLockOptions::Kind::kernel;
  return options;
}

std::optional<std::filesystem::path> run_folder_around(const std::filesystem::path& path) {
  std::filesystem::path folder = std::filesystem::weakly_canonical(std::filesystem::absolute(path)).parent_path();
  if (folder.filename() == "checkpoints") folder = folder.parent_path();
  const RunFolder run(folder);
  std::error_code error;
  if (std::filesystem::exists(run.lock_file(), error) || std::filesystem::exists(run.event_log(), error) ||
      std::filesystem::is_directory(folder / "checkpoints", error))
    return folder;
  return std::nullopt;
}

}  // namespace earshot
