// SPDX-License-Identifier: Apache-2.0
#include "trainer/collective/shared_memory.h"

#include <fcntl.h>
#include <fmt/format.h>
#include <sys/mman.h>
#include <sys/stat.h>
#include <unistd.h>

#include <cerrno>
#include <cstring>
#include <utility>

#include "sim/base/errors.h"

namespace earshot {
namespace {

constexpr const char* kName = "shared memory";

[[noreturn]] void fail(int file, const std::string& operation, int error) {
  if (file >= 0) ::close(file);
  throw RunError(kName, fmt::format("{}: {}", operation, std::strerror(error)));
}

}  // namespace

SharedMemory::SharedMemory(int file, std::size_t bytes) : file_(file), size_(bytes) {
  address_ = ::mmap(nullptr, bytes, PROT_READ | PROT_WRITE, MAP_SHARED, file, 0);
  if (address_ == MAP_FAILED) fail(file, "cannot be mapped", errno);
}

SharedMemory::SharedMemory(SharedMemory&& other) noexcept
    : file_(std::exchange(other.file_, -1)), address_(std::exchange(other.address_, nullptr)), size_(other.size_) {}

SharedMemory::~SharedMemory() {
  if (address_ != nullptr) ::munmap(address_, size_);
  if (file_ >= 0) ::close(file_);
}

SharedMemory SharedMemory::create(std::size_t bytes) {
  const int file = ::memfd_create("earshot", MFD_CLOEXEC);
  if (file < 0) fail(file, "cannot be created", errno);
  if (const int error = ::posix_fallocate(file, 0, static_cast<off_t>(bytes)); error != 0)
    fail(file, fmt::format("cannot take {} bytes", bytes), error);
  return {file, bytes};
}

SharedMemory SharedMemory::open(const std::string& path, std::size_t bytes) {
  const int file = ::open(path.c_str(), O_RDWR | O_CLOEXEC);
  if (file < 0) fail(file, fmt::format("{} cannot be opened", path), errno);
  struct stat status {};
  if (::fstat(file, &status) != 0) fail(file, path, errno);
  if (static_cast<std::size_t>(status.st_size) != bytes) {
    ::close(file);
    throw RunError(kName, fmt::format("{} has {} bytes instead of {}", path, status.st_size, bytes));
  }
  return {file, bytes};
}

std::string SharedMemory::path() const { return fmt::format("/proc/{}/fd/{}", ::getpid(), file_); }

}  // namespace earshot
