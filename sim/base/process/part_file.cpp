// SPDX-License-Identifier: Apache-2.0
#include "sim/base/process/part_file.h"

#include <fcntl.h>
#include <sys/file.h>
#include <sys/stat.h>
#include <unistd.h>

#include <cerrno>
#include <cstdio>
#include <string>
#include <system_error>
#include <utility>

#include "sim/base/errors.h"

namespace earshot {
namespace {

[[noreturn]] void fail_part(const std::filesystem::path& path, const char* operation) {
  throw RunError(path.string(), std::string(operation) + ": " + std::generic_category().message(errno));
}

/// Waits for another writer.  A file system without locks has one writer per file, as nothing can be known of others.
void lock_part(int descriptor) {
  while (::flock(descriptor, LOCK_EX) != 0 && errno == EINTR) {
  }
}

/// Whether the path still names the open file: another writer may have given it its final name in the meantime.
bool names_file(const std::filesystem::path& path, int descriptor) {
  struct stat open_file {
  }, named{};
  return ::fstat(descriptor, &open_file) == 0 && ::stat(path.c_str(), &named) == 0 && open_file.st_dev == named.st_dev &&
         open_file.st_ino == named.st_ino;
}

}  // namespace

PartFile::PartFile(std::filesystem::path path) : path_(std::move(path)), part_(path_) {
  part_ += ".part";
  if (path_.has_parent_path()) {
    std::error_code error;
    std::filesystem::create_directories(path_.parent_path(), error);
    if (error) throw RunError(path_.parent_path().string(), "cannot be created: " + error.message());
  }
  for (;;) {
    descriptor_ = ::open(part_.c_str(), O_WRONLY | O_CREAT | O_CLOEXEC, 0644);
    if (descriptor_ < 0) fail_part(part_, "cannot be opened");
    lock_part(descriptor_);
    if (names_file(part_, descriptor_)) break;
    ::close(descriptor_);
  }
  if (::ftruncate(descriptor_, 0) != 0) {
    const int error = errno;
    ::close(descriptor_);
    errno = error;
    fail_part(part_, "cannot be emptied");
  }
}

PartFile::~PartFile() {
  if (!is_kept_) ::unlink(part_.c_str());
  ::close(descriptor_);
}

void PartFile::append(std::string_view bytes) {
  while (!bytes.empty()) {
    const ssize_t written = ::write(descriptor_, bytes.data(), bytes.size());
    if (written < 0 && errno == EINTR) continue;
    if (written <= 0) fail_part(path_, "cannot be written");
    bytes.remove_prefix(static_cast<std::size_t>(written));
  }
}

void PartFile::flush() {
  if (::fsync(descriptor_) != 0) fail_part(path_, "cannot be flushed");
}

void PartFile::keep() {
  if (std::rename(part_.c_str(), path_.c_str()) != 0) fail_part(path_, "cannot be replaced");
  is_kept_ = true;
}

}  // namespace earshot
