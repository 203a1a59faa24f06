// SPDX-License-Identifier: Apache-2.0
#include "sim/audio/dry_sounds/sound_bytes.h"

#include <algorithm>

#include "sim/base/errors.h"

namespace earshot {
namespace {

constexpr std::size_t kWindowBytes = std::size_t{1} << 16;

}  // namespace

SoundBytes::SoundBytes(const std::filesystem::path& path) : name_(path.string()), stream_(path, std::ios::binary) {
  std::error_code error;
  size_ = std::filesystem::file_size(path, error);
  if (!stream_ || error) throw InputError(name_, "cannot be read", "check its permissions");
}

std::string_view SoundBytes::at(std::uint64_t place, std::size_t count) {
  if (place >= size_) return {};
  const bool inside = place >= window_start_ && place - window_start_ + count <= window_.size();
  if (!inside) {
    const std::uint64_t wanted = std::min<std::uint64_t>(std::max(count, kWindowBytes), size_ - place);
    window_.resize(static_cast<std::size_t>(wanted));
    stream_.clear();
    stream_.seekg(static_cast<std::streamoff>(place));
    stream_.read(window_.data(), static_cast<std::streamsize>(wanted));
    window_.resize(static_cast<std::size_t>(stream_.gcount()));
    window_start_ = place;
  }
  return std::string_view(window_).substr(static_cast<std::size_t>(place - window_start_), count);
}

std::uint64_t SoundBytes::big_endian(std::uint64_t place, std::size_t count) {
  std::uint64_t value = 0;
  const std::string_view bytes = at(place, count);
  if (bytes.size() < count) return 0;
  for (const char byte : bytes) value = value << 8 | static_cast<unsigned char>(byte);
  return value;
}

std::uint64_t SoundBytes::little_endian(std::uint64_t place, std::size_t count) {
  std::uint64_t value = 0;
  const std::string_view bytes = at(place, count);
  if (bytes.size() < count) return 0;
  for (std::size_t i = count; i > 0; --i) value = value << 8 | static_cast<unsigned char>(bytes[i - 1]);
  return value;
}

}  // namespace earshot
