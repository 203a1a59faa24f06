// SPDX-License-Identifier: Apache-2.0
#include <fmt/format.h>

#include <array>
#include <map>

#include "sim/audio/dry_sounds/sound_walks.h"

namespace earshot {
namespace {

constexpr std::size_t kPageHead = 27, kChecksumPlace = 22;

struct OggStream {
  std::uint64_t next_page = 0;
  bool has_ended = false;
};

/// RFC 3533, section 6: polynomial 0x04C11DB7, no reflection, the checksum itself counted as 0.
std::uint32_t page_checksum(std::string_view page) {
  static const std::array<std::uint32_t, 256> table = [] {
    std::array<std::uint32_t, 256> built{};
    for (std::uint32_t i = 0; i < 256; ++i) {
      std::uint32_t value = i << 24;
      for (int bit = 0; bit < 8; ++bit) value = (value << 1) ^ (value >> 31 ? 0x04C11DB7u : 0u);
      built[i] = value;
    }
    return built;
  }();
  std::uint32_t checksum = 0;
  for (std::size_t i = 0; i < page.size(); ++i) {
    const bool is_checksum = i >= kChecksumPlace && i < kChecksumPlace + 4;
    const std::uint32_t byte = is_checksum ? 0u : static_cast<unsigned char>(page[i]);
    checksum = (checksum << 8) ^ table[(checksum >> 24) ^ byte];
  }
  return checksum;
}

/// Size of the page at `place`, its head and its segments.
std::uint64_t page_size(SoundBytes& bytes, std::uint64_t place) {
  const std::uint64_t segments = bytes.little_endian(place + 26, 1);
  std::uint64_t size = kPageHead + segments;
  for (const char lacing : bytes.at(place + kPageHead, static_cast<std::size_t>(segments))) size += static_cast<unsigned char>(lacing);
  return size;
}

}  // namespace

void walk_ogg_pages(SoundBytes& bytes, std::uint64_t start) {
  std::map<std::uint64_t, OggStream> streams;
  const auto all_ended = [&] {
    for (const auto& [serial, stream] : streams)
      if (!stream.has_ended) return false;
    return true;
  };
  bool past_first_pages = false;
  for (std::uint64_t place = start; place < bytes.size();) {
    if (bytes.at(place, 4) != "OggS") {
      if (all_ended()) return;  // a tag behind the sound
      throw damaged_at(bytes.name(), place, "no Ogg page starts there");
    }
    const std::uint64_t size = page_size(bytes, place);
    if (place + kPageHead > bytes.size() || place + size > bytes.size()) throw cut_short(bytes.name(), place + size, bytes.size());
    const std::uint64_t checksum = bytes.little_endian(place + kChecksumPlace, 4);
    if (page_checksum(bytes.at(place, static_cast<std::size_t>(size))) != checksum)
      throw damaged_at(bytes.name(), place, "the checksum of a page is wrong");
    const std::uint64_t flags = bytes.little_endian(place + 5, 1), number = bytes.little_endian(place + 18, 4);
    const bool is_first = (flags & 2) != 0;
    if (is_first && past_first_pages)
      throw InputError(bytes.name(), "contains several sounds in sequence (chained Ogg)", "split it into one file per sound");
    past_first_pages = past_first_pages || !is_first;
    OggStream& stream = streams[bytes.little_endian(place + 14, 4)];
    if (!is_first && number != stream.next_page) throw damaged_at(bytes.name(), place, "a page is missing");
    stream.next_page = (number + 1) & 0xFFFFFFFFu;
    stream.has_ended = (flags & 4) != 0;
    place += size;
  }
  if (!all_ended()) throw InputError(bytes.name(), "is truncated: its last page does not end the stream", "copy or export the sound again");
}

}  // namespace earshot
