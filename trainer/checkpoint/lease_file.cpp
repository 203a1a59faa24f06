// SPDX-License-Identifier: Apache-2.0
#include "trainer/checkpoint/lease_file.h"

#include <fcntl.h>
#include <fmt/format.h>
#include <signal.h>
#include <sys/stat.h>
#include <sys/vfs.h>
#include <unistd.h>

#include <algorithm>
#include <array>
#include <cerrno>
#include <utility>

#include "sim/base/errors.h"
#include "sim/base/file_descriptor.h"

namespace earshot {
namespace {

constexpr int kRenewalsPerLease = 6;

/// f_type of statfs(2); those that <linux/magic.h> does not have are of their own sources.
constexpr std::array<std::uint32_t, 17> kShared{
    0x6969,      // NFS
    0x517B,      // SMB
    0xFF534D42,  // CIFS
    0xFE534D42,  // SMB 2
    0x0BD00BD0,  // Lustre
    0x47504653,  // GPFS
    0x00C36400,  // Ceph
    0x5346414F,  // AFS
    0x6B414653,  // kAFS
    0x73757245,  // Coda
    0x65735546,  // FUSE: sshfs, GlusterFS, object stores
    0x01021997,  // 9P
    0x7461636F,  // OCFS2
    0x01161970,  // GFS2
    0x19830326,  // BeeGFS
    0x20030528,  // OrangeFS
    0xAAD7AAEA   // PanFS
};

std::chrono::nanoseconds time_of(const timespec& time) {
  return std::chrono::seconds(time.tv_sec) + std::chrono::nanoseconds(time.tv_nsec);
}

/// A file of its own beside `path`, removed at the end.
class FileBeside {
 public:
  explicit FileBeside(const std::filesystem::path& path, const std::string& token)
      : path_(path.string() + ".tmp" + token), descriptor_(::open(path_.c_str(), O_WRONLY | O_CREAT | O_EXCL | O_CLOEXEC, 0666)) {
    if (descriptor_.get() < 0) throw InputError(path_.string(), "cannot be created: " + last_error(), "name a folder that can be written");
  }
  ~FileBeside() {
    if (!path_.empty()) ::unlink(path_.c_str());
  }
  FileBeside(const FileBeside&) = delete;
  FileBeside& operator=(const FileBeside&) = delete;

  void write(const std::string& text) {
    if (::write(descriptor_.get(), text.data(), text.size()) != static_cast<ssize_t>(text.size()) || ::fsync(descriptor_.get()) != 0)
      throw RunError(path_.string(), "cannot be written: " + last_error());
  }
  /// By the clock of the file system.
  [[nodiscard]] std::chrono::nanoseconds now() const {
    struct stat status {};
    return ::futimens(descriptor_.get(), nullptr) == 0 && ::fstat(descriptor_.get(), &status) == 0 ? time_of(status.st_mtim)
                                                                                                   : std::chrono::nanoseconds(0);
  }
  bool rename_to(const std::filesystem::path& target) {
    if (::rename(path_.c_str(), target.c_str()) != 0) return false;
    path_.clear();
    return true;
  }

 private:
  std::filesystem::path path_;
  Descriptor descriptor_;
};

struct Seen {
  std::optional<LockRecord> record;
  std::chrono::nanoseconds renewed{};
};

/// Opened anew, so that a client of NFS asks its server.
std::optional<Seen> look_at(const std::filesystem::path& path) {
  const Descriptor file(::open(path.c_str(), O_RDONLY | O_CLOEXEC));
  struct stat status {};
  if (file.get() < 0 || ::fstat(file.get(), &status) != 0) return std::nullopt;
  return Seen{read_lock_record(file.get()), time_of(status.st_mtim)};
}

bool is_old(const Seen& seen, const FileBeside& beside, std::chrono::milliseconds lease) {
  return (seen.record && is_known_gone(*seen.record)) || beside.now() - seen.renewed >= lease;
}

/// A holder by the kernel on a host of which nothing is known renews nothing.
bool may_be_replaced(const Seen& seen, const FileBeside& beside, std::chrono::milliseconds lease, const std::string& run) {
  if (seen.record && seen.record->run == run) return true;
  if (seen.record && !seen.record->is_lease) return is_known_gone(*seen.record);
  return is_old(seen, beside, lease);
}

/// Under the guard of a second file, which is itself old where whoever made it was killed between two calls.
bool replace(const std::filesystem::path& path, FileBeside& beside, const LockRecord& record, std::chrono::milliseconds lease) {
  const std::filesystem::path guard = path.string() + ".next";
  const Descriptor made(::open(guard.c_str(), O_WRONLY | O_CREAT | O_EXCL | O_CLOEXEC, 0666));
  if (made.get() < 0) {
    const auto seen = look_at(guard);
    if (seen && beside.now() - seen->renewed >= lease) ::unlink(guard.c_str());
    return false;
  }
  const auto seen = look_at(path);
  const bool taken = (!seen || may_be_replaced(*seen, beside, lease, record.run)) && beside.rename_to(path);
  ::unlink(guard.c_str());
  const auto after = taken ? look_at(path) : std::nullopt;
  return after && after->record && after->record->token == record.token;
}

}  // namespace

bool is_shared_file_system(const std::filesystem::path& path) {
  struct statfs status {};
  return ::statfs(path.c_str(), &status) == 0 && std::ranges::find(kShared, static_cast<std::uint32_t>(status.f_type)) != kShared.end();
}

bool is_old_lease(const std::filesystem::path& path, std::chrono::milliseconds lease) {
  const auto seen = look_at(path);
  if (!seen) return false;
  const FileBeside beside(path, own_lock_record("", "").token);
  return is_old(*seen, beside, lease);
}

std::unique_ptr<LeaseFile> LeaseFile::try_take(const std::filesystem::path& path, const LockRecord& record,
                                               std::chrono::milliseconds lease) {
  FileBeside beside(path, record.token);
  const Descriptor made(::open(path.c_str(), O_WRONLY | O_CREAT | O_EXCL | O_CLOEXEC, 0666));
  const std::string text = encode_lock_record(record);
  if (made.get() >= 0) {
    if (::write(made.get(), text.data(), text.size()) != static_cast<ssize_t>(text.size()) || ::fsync(made.get()) != 0) {
      const std::string why = last_error();
      ::unlink(path.c_str());
      throw RunError(path.string(), "cannot be written: " + why);
    }
  } else {
    if (errno != EEXIST) throw InputError(path.string(), "cannot be created: " + last_error(), "name a folder that can be written");
    const auto seen = look_at(path);
    if (!seen || !may_be_replaced(*seen, beside, lease, record.run)) return nullptr;
    beside.write(text);
    if (!replace(path, beside, record, lease)) return nullptr;
  }
  return std::unique_ptr<LeaseFile>(new LeaseFile(path, record.token, lease));
}

LeaseFile::LeaseFile(std::filesystem::path path, std::string token, std::chrono::milliseconds lease)
    : path_(std::move(path)), token_(std::move(token)), interval_(lease / kRenewalsPerLease) {
  sigset_t all, before;
  sigfillset(&all);
  ::pthread_sigmask(SIG_SETMASK, &all, &before);  // signals are for the thread that waits for them
  renewing_ = std::thread([this] { renew_until_the_end(); });
  ::pthread_sigmask(SIG_SETMASK, &before, nullptr);
}

LeaseFile::~LeaseFile() {
  {
    const std::lock_guard lock(mutex_);
    is_ending_ = true;
  }
  wake_.notify_one();
  renewing_.join();
  const auto seen = look_at(path_);
  if (seen && seen->record && seen->record->token == token_) ::unlink(path_.c_str());
}

bool LeaseFile::is_lost() const {
  const std::lock_guard lock(mutex_);
  return is_lost_;
}

void LeaseFile::renew_until_the_end() {
  std::unique_lock lock(mutex_);
  while (!wake_.wait_for(lock, interval_, [this] { return is_ending_; })) {
    lock.unlock();
    bool lost = false;
    // The file server may be unreachable for a while: an unreadable file is not lost yet.
    const Descriptor file(::open(path_.c_str(), O_WRONLY | O_CLOEXEC));
    if (file.get() >= 0) {
      const auto seen = look_at(path_);
      lost = seen && seen->record && seen->record->token != token_;
      if (!lost) ::futimens(file.get(), nullptr);
    } else {
      lost = errno == ENOENT;
    }
    lock.lock();
    is_lost_ = is_lost_ || lost;
  }
}

}  // namespace earshot
