// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstddef>
#include <span>
#include <string>

namespace earshot {

/// Zeroed memory that several processes of one user on one machine map.  It has no name in any file system: it goes with the last process
/// that maps it, however that ends.  One owner; the mapping ends with it.
class SharedMemory {
 public:
  /// Allocates the memory at once, so that later writes cannot run out of memory.  Throws RunError.
  static SharedMemory create(std::size_t bytes);
  /// Maps the memory of another process by its path(); that process must still exist.  Throws RunError: no such process, another user's,
  /// another number of bytes.
  static SharedMemory open(const std::string& path, std::size_t bytes);
  SharedMemory(SharedMemory&& other) noexcept;
  SharedMemory& operator=(SharedMemory&&) = delete;
  ~SharedMemory();

  [[nodiscard]] std::span<std::byte> bytes() const { return {static_cast<std::byte*>(address_), size_}; }
  /// Path for other processes.
  [[nodiscard]] std::string path() const;

 private:
  SharedMemory(int file, std::size_t bytes);
  int file_ = -1;
  void* address_ = nullptr;
  std::size_t size_ = 0;
};

}  // namespace earshot
