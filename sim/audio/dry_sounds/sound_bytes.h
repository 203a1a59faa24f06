// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstddef>
#include <cstdint>
#include <filesystem>
#include <fstream>
#include <string>
#include <string_view>

namespace earshot {

/// A file of sound as bytes at places.  Keeps a window of 64 KiB, so that reading on is cheap.
class SoundBytes {
 public:
  /// Throws InputError: the file cannot be read.
  explicit SoundBytes(const std::filesystem::path& path);
  [[nodiscard]] const std::string& name() const { return name_; }
  [[nodiscard]] std::uint64_t size() const { return size_; }
  /// `count` bytes, fewer at the end of the file.  Valid until the next call.
  std::string_view at(std::uint64_t place, std::size_t count);
  /// Unsigned numbers of 1 to 8 bytes; 0 beyond the end of the file.
  std::uint64_t big_endian(std::uint64_t place, std::size_t count);
  std::uint64_t little_endian(std::uint64_t place, std::size_t count);

 private:
  std::string name_;
  std::ifstream stream_;
  std::uint64_t size_ = 0, window_start_ = 0;
  std::string window_;
};

}  // namespace earshot
