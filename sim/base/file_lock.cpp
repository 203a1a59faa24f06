// SPDX-License-Identifier: Apache-2.0
#include "sim/base/file_lock.h"

#include <fcntl.h>
#include <sys/file.h>
#include <sys/stat.h>
#include <unistd.h>

#include <cerrno>
#include <thread>
#include <utility>

namespace earshot {
namespace {

constexpr std::chrono::milliseconds kBetweenTries(5);

/// Whether `path` still names the file behind the descriptor: the holder before removes the file, and a lock on a removed one excludes
/// no other process.
bool is_file_at(const std::filesystem::path& path, int descriptor) {
  struct stat held {};
  struct stat named {};
  return ::fstat(descriptor, &held) == 0 && ::stat(path.c_str(), &named) == 0 && held.st_dev == named.st_dev && held.st_ino == named.st_ino;
}

}  // namespace

FileLock::FileLock(std::filesystem::path path, int descriptor) : path_(std::move(path)), descriptor_(descriptor) {}

FileLock::FileLock(FileLock&& other) noexcept : path_(std::move(other.path_)), descriptor_(std::exchange(other.descriptor_, -1)) {}

FileLock::~FileLock() {
  if (descriptor_ < 0) return;
  ::unlink(path_.c_str());  // first: a waiting process finds its file removed, and creates a new one
  ::close(descriptor_);
}

std::optional<FileLock> FileLock::acquire(const std::filesystem::path& path, std::chrono::milliseconds patience) {
  const auto deadline = std::chrono::steady_clock::now() + patience;
  while (true) {
    const int descriptor = ::open(path.c_str(), O_RDWR | O_CREAT | O_CLOEXEC | O_NONBLOCK, 0666);
    if (descriptor < 0) return std::nullopt;
    if (::flock(descriptor, LOCK_EX | LOCK_NB) == 0) {
      if (is_file_at(path, descriptor)) return FileLock(path, descriptor);
    } else if (errno != EWOULDBLOCK && errno != EINTR) {
      ::close(descriptor);
      return std::nullopt;
    }
    ::close(descriptor);
    if (std::chrono::steady_clock::now() >= deadline) return std::nullopt;
    std::this_thread::sleep_for(kBetweenTries);
  }
}

}  // namespace earshot
