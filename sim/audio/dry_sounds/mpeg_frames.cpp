// SPDX-License-Identifier: Apache-2.0
#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <optional>

#include "sim/audio/dry_sounds/sound_walks.h"

namespace earshot {
namespace {

struct MpegFrame {
  std::uint64_t bytes = 0, samples = 0;
  bool is_version_1 = false, is_mono = false;
};

using BitRates = std::array<int, 15>;  // kbit/s by index; 0 is free format
constexpr BitRates kVersion1Layer1{0, 32, 64, 96, 128, 160, 192, 224, 256, 288, 320, 352, 384, 416, 448};
constexpr BitRates kVersion1Layer2{0, 32, 48, 56, 64, 80, 96, 112, 128, 160, 192, 224, 256, 320, 384};
constexpr BitRates kVersion1Layer3{0, 32, 40, 48, 56, 64, 80, 96, 112, 128, 160, 192, 224, 256, 320};
constexpr BitRates kVersion2Layer1{0, 32, 48, 56, 64, 80, 96, 112, 128, 144, 160, 176, 192, 224, 256};
constexpr BitRates kVersion2Others{0, 8, 16, 24, 32, 40, 48, 56, 64, 80, 96, 112, 128, 144, 160};

/// Nothing where no header of a frame is; a frame of free format has 0 bytes.
std::optional<MpegFrame> frame_of(std::uint64_t head) {
  const auto version = head >> 19 & 3, layer_code = head >> 17 & 3, rate_index = head >> 12 & 15, frequency_index = head >> 10 & 3;
  if (head >> 21 != 0x7FF || version == 1 || layer_code == 0 || rate_index == 15 || frequency_index == 3) return std::nullopt;
  const int layer = 4 - static_cast<int>(layer_code);
  MpegFrame frame{.is_version_1 = version == 3, .is_mono = (head >> 6 & 3) == 3};
  const BitRates& rates = frame.is_version_1 ? (layer == 1   ? kVersion1Layer1
                                                : layer == 2 ? kVersion1Layer2
                                                             : kVersion1Layer3)
                                             : (layer == 1 ? kVersion2Layer1 : kVersion2Others);
  constexpr std::array<std::uint64_t, 3> kFrequencies{44100, 48000, 32000};
  const std::uint64_t frequency = kFrequencies[frequency_index] / (version == 3 ? 1 : version == 2 ? 2 : 4);
  const std::uint64_t bits_per_s = 1000 * static_cast<std::uint64_t>(rates[rate_index]), padding = head >> 9 & 1;
  frame.samples = layer == 1 ? 384 : layer == 3 && !frame.is_version_1 ? 576 : 1152;
  if (bits_per_s == 0) return frame;
  frame.bytes = layer == 1 ? 4 * (12 * bits_per_s / frequency + padding) : frame.samples / 8 * bits_per_s / frequency + padding;
  return frame;
}

/// The length that the first frame states (Xing, Info, VBRI); 0: it does not.
struct StatedLength {
  bool is_stated = false;
  std::uint64_t frames = 0, bytes = 0;
};

StatedLength stated_length(SoundBytes& bytes, std::uint64_t place, const MpegFrame& frame) {
  const std::uint64_t side = frame.is_version_1 ? (frame.is_mono ? 17 : 32) : (frame.is_mono ? 9 : 17);
  for (const std::uint64_t tag : {place + 4 + side, place + 6 + side}) {  // without and with a checksum before it
    const std::string name(bytes.at(tag, 4));
    if (name != "Xing" && name != "Info") continue;
    const std::uint64_t fields = bytes.big_endian(tag + 4, 4);
    StatedLength stated{.is_stated = true};
    if (fields & 1) stated.frames = bytes.big_endian(tag + 8, 4);
    if (fields & 2) stated.bytes = bytes.big_endian(tag + (fields & 1 ? 12 : 8), 4);
    return stated;
  }
  const std::uint64_t tag = place + 36;
  if (bytes.at(tag, 4) != "VBRI") return {};
  return {.is_stated = true, .frames = bytes.big_endian(tag + 14, 4), .bytes = bytes.big_endian(tag + 10, 4)};
}

/// Throws InputError where the bytes from `place` on, which are no frame, hold sound that a decoder would find or lose.
void require_tail(SoundBytes& bytes, std::uint64_t place) {
  const std::string head(bytes.at(place, 8));
  if (head.starts_with("TAG") || head.starts_with("APETAGEX") || head.starts_with("LYRICS")) return;
  constexpr std::uint64_t kSearched = 1 << 16;
  const std::uint64_t end = std::min(bytes.size(), place + kSearched);
  for (std::uint64_t at = place; at + 4 <= end; ++at) {
    const auto frame = frame_of(bytes.big_endian(at, 4));
    if (frame && frame->bytes > 0 && frame_of(bytes.big_endian(at + frame->bytes, 4)))
      throw damaged_at(bytes.name(), place, "no MPEG audio frame starts there");
  }
}

}  // namespace

std::uint64_t walk_mpeg_frames(SoundBytes& bytes, std::uint64_t start) {
  std::uint64_t place = start, count = 0, samples_per_frame = 0;
  StatedLength stated;
  for (; place < bytes.size(); ++count) {
    const auto frame = frame_of(bytes.big_endian(place, 4));
    if (!frame) break;
    if (frame->bytes == 0) return 0;
    if (count == 0) {
      samples_per_frame = frame->samples;
      stated = stated_length(bytes, place, *frame);
      if (stated.bytes > 0 && place + stated.bytes > bytes.size()) throw cut_short(bytes.name(), place + stated.bytes, bytes.size());
    }
    if (place + frame->bytes > bytes.size()) throw cut_short(bytes.name(), place + frame->bytes, bytes.size());
    place += frame->bytes;
  }
  if (count == 0) return 0;
  require_tail(bytes, place);
  if (!stated.is_stated) return (count - 1) * samples_per_frame;  // the first frame may need bits of one before it
  const std::uint64_t sounding = count - 1;
  // Some encoders count the frame that states the length.
  if (stated.frames > 0 && (sounding > stated.frames || sounding + 1 < stated.frames))
    throw InputError(bytes.name(), fmt::format("has {} frames of MPEG audio, but its header states {}", sounding, stated.frames),
                     "copy or export the sound again");
  return 0;
}

}  // namespace earshot
