// SPDX-License-Identifier: Apache-2.0
#include "sim/audio/dry_sounds/sound_extent.h"

#include <fmt/format.h>

#include <algorithm>
#include <charconv>
#include <cstdlib>

#include "sim/audio/dry_sounds/sound_walks.h"

namespace earshot {
namespace {

constexpr std::uint64_t kPlaceholderWidth = 1 << 16;

/// A size that programs write before they know the length of what they pipe.
bool is_placeholder(std::uint64_t size) {
  if (size == 0) return true;
  for (const std::uint64_t written : {std::uint64_t{0x7F000000}, std::uint64_t{1} << 31, std::uint64_t{1} << 32})
    if (size + kPlaceholderWidth > written && size < written + kPlaceholderWidth) return true;
  return size >= std::uint64_t{1} << 62;  // -1 in 64 bits
}

/// The field of a header that holds the number of bytes of sound.
struct SizeField {
  std::uint64_t place = 0, start = 0;  ///< of the field; of the bytes that it counts
  std::uint64_t size = 0;
  std::size_t width = 4;
  bool is_big_endian = false;
};

std::string number_bytes(std::uint64_t value, const SizeField& field) {
  std::string bytes(field.width, '\0');
  for (std::size_t i = 0; i < field.width; ++i) {
    const std::size_t at = field.is_big_endian ? field.width - 1 - i : i;
    bytes[at] = static_cast<char>(value >> (8 * i) & 0xFF);
  }
  return bytes;
}

SoundExtent extent_of(const SoundBytes& bytes, const SizeField& field) {
  SoundExtent extent;
  const std::uint64_t present = bytes.size() - std::min(bytes.size(), field.start);
  if (field.size > 0 && field.size <= present) return extent;
  if (!is_placeholder(field.size)) throw cut_short(bytes.name(), field.start + field.size, bytes.size());
  extent.size_place = field.place;
  if (present > 0 && (field.width == 8 || present < std::uint64_t{1} << 32)) extent.size_bytes = number_bytes(present, field);
  return extent;
}

/// How a file of chunks is written: 4 bytes of name and of size, padded to even.
struct ChunkStyle {
  bool is_big_endian = false;
  std::string_view sound, other_sound;  ///< names of the chunk of sound
};

std::uint64_t chunk_size(SoundBytes& bytes, std::uint64_t place, bool is_big_endian) {
  return is_big_endian ? bytes.big_endian(place + 4, 4) : bytes.little_endian(place + 4, 4);
}

/// Whether chunks follow from `place` to the end: an empty chunk of sound is then an empty sound.
bool are_chunks(SoundBytes& bytes, std::uint64_t place, bool is_big_endian) {
  while (place + 8 <= bytes.size()) {
    for (const char c : bytes.at(place, 4))
      if (c < ' ' || c > '~') return false;
    const std::uint64_t size = chunk_size(bytes, place, is_big_endian);
    place += 8 + size + (size & 1);
  }
  return place == bytes.size() || place == bytes.size() + 1;
}

SoundExtent extent_of_chunks(SoundBytes& bytes, std::uint64_t start, const ChunkStyle& style) {
  std::uint64_t long_size = 0, long_place = 0;  // of RF64
  for (std::uint64_t place = start + 12; place + 8 <= bytes.size();) {
    const std::string name(bytes.at(place, 4));
    const std::uint64_t size = chunk_size(bytes, place, style.is_big_endian);
    if (name == "ds64") long_place = place + 16, long_size = bytes.little_endian(long_place, 8);
    if (name == style.sound || name == style.other_sound) {
      const SizeField field{.place = place + 4, .start = place + 8, .size = size, .width = 4, .is_big_endian = style.is_big_endian};
      if (size == 0 && are_chunks(bytes, place + 8, style.is_big_endian)) return {};
      if (long_size == 0 || size != 0xFFFFFFFFu) return extent_of(bytes, field);
      return extent_of(bytes, {.place = long_place, .start = place + 8, .size = long_size, .width = 8});
    }
    place += 8 + size + (size & 1);
  }
  return {};
}

/// W64: names of 16 bytes, sizes of 8 that count the 24 of the head, padded to 8.
SoundExtent extent_of_w64(SoundBytes& bytes, std::uint64_t start) {
  for (std::uint64_t place = start + 40; place + 24 <= bytes.size();) {
    const std::uint64_t size = bytes.little_endian(place + 16, 8);
    if (bytes.at(place, 4) == "data") {
      if (size < 24 || is_placeholder(size - 24)) return {};
      return extent_of(bytes, {.place = place + 16, .start = place + 24, .size = size - 24, .width = 8});
    }
    if (size < 24 || size > bytes.size()) return {};
    place += (size + 7) / 8 * 8;
  }
  return {};
}

SoundExtent extent_of_caf(SoundBytes& bytes, std::uint64_t start) {
  for (std::uint64_t place = start + 8; place + 12 <= bytes.size();) {
    const std::uint64_t size = bytes.big_endian(place + 4, 8);
    const SizeField field{.place = place + 4, .start = place + 12, .size = size, .width = 8, .is_big_endian = true};
    if (bytes.at(place, 4) == "data") return extent_of(bytes, field);
    if (size > bytes.size()) return {};
    place += 12 + size;
  }
  return {};
}

SoundExtent extent_of_au(SoundBytes& bytes, std::uint64_t start, bool is_big_endian) {
  const auto number = [&](std::uint64_t place) { return is_big_endian ? bytes.big_endian(place, 4) : bytes.little_endian(place, 4); };
  const SizeField field{
      .place = start + 8, .start = start + number(start + 4), .size = number(start + 8), .width = 4, .is_big_endian = is_big_endian};
  return extent_of(bytes, field);
}

/// NIST SPHERE: a head of text with lines like "sample_count -i 16000".
SoundExtent extent_of_nist(SoundBytes& bytes, std::uint64_t start) {
  const std::string head(bytes.at(start, 1024));
  const auto number = [&](std::string_view key, std::uint64_t otherwise) {
    const std::size_t line = head.find("\n" + std::string(key) + " -i ");
    if (line == std::string::npos) return otherwise;
    std::uint64_t value = 0;
    const std::size_t digits = line + key.size() + 5;
    std::from_chars(head.data() + digits, head.data() + head.size(), value);
    return value;
  };
  const std::uint64_t head_bytes = std::strtoull(head.substr(std::min<std::size_t>(8, head.size()), 8).c_str(), nullptr, 10);
  const std::size_t coding = head.find("\nsample_coding "), coding_end = head.find('\n', coding + 1);
  // Codes of a byte, whatever sample_n_bytes says of them: libsndfile writes 2.
  const bool is_law = coding != std::string::npos && head.substr(coding, coding_end - coding).find("law") != std::string::npos;
  const std::uint64_t sample_bytes = is_law ? 1 : number("sample_n_bytes", 2);
  const std::uint64_t frames = number("sample_count", 0), width = number("channel_count", 1) * sample_bytes;
  if (frames == 0 || width == 0 || frames > (std::uint64_t{1} << 40) || width > (1 << 20)) return {};
  const std::uint64_t end = start + head_bytes + frames * width;
  if (end > bytes.size()) throw cut_short(bytes.name(), end, bytes.size());
  return {};
}

/// Bytes of a tag (ID3v2) before the sound.
std::uint64_t tag_size(SoundBytes& bytes) {
  if (bytes.at(0, 3) != "ID3") return 0;
  std::uint64_t size = 0;
  for (const char byte : bytes.at(6, 4)) size = size << 7 | (static_cast<unsigned char>(byte) & 0x7F);
  const bool has_footer = (bytes.little_endian(5, 1) & 0x10) != 0;
  return size + (has_footer ? 20 : 10);
}

}  // namespace

InputError cut_short(const std::string& name, std::uint64_t stated_bytes, std::uint64_t present_bytes) {
  return {name, fmt::format("is truncated: its sound ends at byte {}, the file at byte {}", stated_bytes, present_bytes),
          "copy or export the sound again"};
}

InputError damaged_at(const std::string& name, std::uint64_t place, const std::string& problem) {
  return {name, fmt::format("is damaged at byte {}: {}", place, problem), "copy or export the sound again"};
}

SoundExtent read_sound_extent(const std::filesystem::path& path) {
  SoundBytes bytes(path);
  const std::uint64_t start = tag_size(bytes);
  const std::string head(bytes.at(start, 16));
  const bool is_wave = head.size() >= 12 && head.substr(8, 4) == "WAVE";
  if (is_wave && (head.starts_with("RIFF") || head.starts_with("RF64"))) return extent_of_chunks(bytes, start, {false, "data", "data"});
  if (is_wave && head.starts_with("RIFX")) return extent_of_chunks(bytes, start, {true, "data", "data"});
  if (head.starts_with("FORM")) return extent_of_chunks(bytes, start, {true, "SSND", "BODY"});
  if (head.starts_with("riff\x2E\x91\xCF\x11")) return extent_of_w64(bytes, start);
  if (head.starts_with("caff")) return extent_of_caf(bytes, start);
  if (head.starts_with(".snd")) return extent_of_au(bytes, start, true);
  if (head.starts_with("dns.")) return extent_of_au(bytes, start, false);
  if (head.starts_with("NIST_1A")) return extent_of_nist(bytes, start);
  if (head.starts_with("OggS")) walk_ogg_pages(bytes, start);
  if (head.size() >= 2 && head[0] == '\xFF' && (head[1] & 0xE0) == 0xE0) return {.least_frames = walk_mpeg_frames(bytes, start)};
  return {};
}

}  // namespace earshot
