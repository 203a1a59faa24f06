// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <chrono>
#include <filesystem>
#include <optional>

namespace earshot {

/// A lock that processes share through a file (flock): held while the value lives, given up by the kernel if its process ends in any way.
/// Threads of one process exclude each other too.  The file is empty, and removed when the lock is given up.
class FileLock {
 public:
  /// Waits up to `patience` for another holder, asking every few milliseconds.  nullopt: it still holds the lock, or the folder cannot be
  /// written or does not know locks.  Never throws for what is on the disk.  Safe from any thread.
  static std::optional<FileLock> acquire(const std::filesystem::path& path, std::chrono::milliseconds patience);
  ~FileLock();
  FileLock(FileLock&& other) noexcept;
  FileLock& operator=(FileLock&&) = delete;

 private:
  FileLock(std::filesystem::path path, int descriptor);
  std::filesystem::path path_;
  int descriptor_;
};

}  // namespace earshot
