// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <chrono>
#include <condition_variable>
#include <filesystem>
#include <memory>
#include <mutex>
#include <optional>
#include <thread>

#include "trainer/checkpoint/lock_record.h"

namespace earshot {

/// Whether other hosts can see this folder too (NFS, Lustre, GPFS, CIFS, FUSE, ...): the kernel's locks may hold on one host alone there.
/// path: is there.
bool is_shared_file_system(const std::filesystem::path& path);

/// A lock that hosts share through a file: its holder renews the file's time, and a file that has not been renewed for the length of the
/// lease is anyone's.  Times are those of the file server, so that clocks of hosts do not matter.
///
/// One file at a fixed path, made with O_EXCL; an old one is replaced by rename under a second such file (".next"), so that only one of
/// several processes replaces it.
class LeaseFile {
 public:
  /// Null: someone else holds it.  record: content of the file; a holder of the same record.run is replaced whatever the age of its lease.
  /// Throws InputError where the folder cannot be written.
  static std::unique_ptr<LeaseFile> try_take(const std::filesystem::path& path, const LockRecord& record, std::chrono::milliseconds lease);
  /// Gives the lock up, if it is still this holder's.
  ~LeaseFile();
  LeaseFile(const LeaseFile&) = delete;
  LeaseFile& operator=(const LeaseFile&) = delete;

  /// Another holder has the file: this one was not able to renew it in time.
  [[nodiscard]] bool is_lost() const;

 private:
  LeaseFile(std::filesystem::path path, std::string token, std::chrono::milliseconds lease);
  void renew_until_the_end();

  const std::filesystem::path path_;
  const std::string token_;
  const std::chrono::milliseconds interval_;
  mutable std::mutex mutex_;
  std::condition_variable wake_;
  bool is_ending_ = false, is_lost_ = false;
  std::thread renewing_;
};

/// Whether the file has not been renewed for that long, by the clock of its file system, or its holder is known to be gone.  False where it
/// is not there.
bool is_old_lease(const std::filesystem::path& path, std::chrono::milliseconds lease);

}  // namespace earshot
