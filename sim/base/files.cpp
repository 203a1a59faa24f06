// SPDX-License-Identifier: Apache-2.0
#include "sim/base/files.h"

#include <fcntl.h>
#include <fmt/format.h>
#include <unistd.h>
#include <xxhash.h>

#include <cerrno>
#include <cstring>
#include <fstream>
#include <system_error>

#include "sim/base/errors.h"
#include "sim/base/file_descriptor.h"

namespace earshot {
namespace {

/// A file descriptor and the temporary file behind it: closed and removed unless the rename succeeded.
class TemporaryFile {
 public:
  explicit TemporaryFile(std::filesystem::path path) : path_(std::move(path)) {
    descriptor_ = ::open(path_.c_str(), O_WRONLY | O_CREAT | O_TRUNC | O_CLOEXEC, 0644);
    if (descriptor_ < 0) throw RunError(path_.string(), "cannot be created: " + last_error());
  }
  TemporaryFile(const TemporaryFile&) = delete;
  TemporaryFile& operator=(const TemporaryFile&) = delete;
  ~TemporaryFile() {
    if (descriptor_ >= 0) ::close(descriptor_);
    if (!kept_) ::unlink(path_.c_str());
  }

  void write(std::string_view bytes) {
    while (!bytes.empty()) {
      const ssize_t written = ::write(descriptor_, bytes.data(), bytes.size());
      if (written < 0 && errno == EINTR) continue;
      if (written <= 0) throw RunError(path_.string(), "cannot be written: " + last_error());
      bytes.remove_prefix(static_cast<std::size_t>(written));
    }
    if (::fsync(descriptor_) != 0) throw RunError(path_.string(), "cannot be flushed: " + last_error());
    const int closed = ::close(descriptor_);
    descriptor_ = -1;
    if (closed != 0) throw RunError(path_.string(), "cannot be closed: " + last_error());
  }

  void rename_to(const std::filesystem::path& target) {
    if (::rename(path_.c_str(), target.c_str()) != 0) throw RunError(target.string(), "cannot be replaced: " + last_error());
    kept_ = true;
    // The name is on disk once the folder is; a file system that cannot say so loses the rename at worst, and the old file is whole.
    const std::filesystem::path folder = target.has_parent_path() ? target.parent_path() : ".";
    const int descriptor = ::open(folder.c_str(), O_RDONLY | O_DIRECTORY | O_CLOEXEC);
    if (descriptor < 0) return;
    ::fsync(descriptor);
    ::close(descriptor);
  }

 private:
  std::filesystem::path path_;
  int descriptor_ = -1;
  bool kept_ = false;
};

}  // namespace

std::string read_file(const std::filesystem::path& path, std::size_t max_bytes) {
  std::error_code error;
  const auto status = std::filesystem::status(path, error);
  if (!std::filesystem::exists(status)) throw InputError(path.string(), "no such file", "check the path");
  if (std::filesystem::is_directory(status)) throw InputError(path.string(), "is a folder, not a file", "give a file in this folder");
  std::ifstream stream(path, std::ios::binary);
  if (!stream) throw InputError(path.string(), "cannot be opened: " + last_error(), "check its permissions");
  std::string bytes;
  std::string block(std::size_t{1} << 20, '\0');
  while (stream) {
    stream.read(block.data(), static_cast<std::streamsize>(block.size()));
    bytes.append(block, 0, static_cast<std::size_t>(stream.gcount()));
    if (bytes.size() > max_bytes)
      throw InputError(path.string(), fmt::format("is larger than {} bytes", max_bytes), "check that it is the right file");
  }
  if (stream.bad()) throw InputError(path.string(), "cannot be read: " + last_error(), "check the disk");
  return bytes;
}

void write_file_atomically(const std::filesystem::path& path, std::string_view bytes) {
  if (path.has_parent_path()) {
    std::error_code error;
    std::filesystem::create_directories(path.parent_path(), error);
    if (error) throw RunError(path.parent_path().string(), "cannot be created: " + error.message());
  }
  // A rename would put a plain file in the place of a device or a folder.
  std::error_code unknown;
  const auto status = std::filesystem::status(path, unknown);
  if (std::filesystem::exists(status) && !std::filesystem::is_regular_file(status))
    throw InputError(path.string(), "is not a regular file", "give a file that can be written or replaced");
  std::filesystem::path temporary = path;
  temporary += fmt::format(".tmp{}", ::getpid());
  TemporaryFile file(temporary);
  file.write(bytes);
  file.rename_to(path);
}

std::uint64_t hash64(std::span<const std::byte> bytes, std::uint64_t seed) {
  return XXH3_64bits_withSeed(bytes.data(), bytes.size(), seed);
}

std::uint64_t hash64(std::string_view bytes, std::uint64_t seed) {
  return hash64(std::as_bytes(std::span(bytes.data(), bytes.size())), seed);
}

std::string hex64(std::uint64_t value) { return fmt::format("{:016x}", value); }

}  // namespace earshot
