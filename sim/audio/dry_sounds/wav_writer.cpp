// SPDX-License-Identifier: Apache-2.0
#include <fmt/format.h>
#include <sndfile.h>

#include <algorithm>
#include <array>
#include <bit>
#include <cmath>
#include <cstdint>
#include <utility>

#include "sim/audio/dry_sounds/memory_file.h"
#include "sim/audio/dry_sounds/sound_clip.h"
#include "sim/audio/dry_sounds/sound_file.h"
#include "sim/base/errors.h"
#include "sim/base/files.h"

namespace earshot {
namespace {

/// Loudspeakers by bit of dwChannelMask.
constexpr std::array<int, 18> kSpeakers = {SF_CHANNEL_MAP_LEFT,
                                           SF_CHANNEL_MAP_RIGHT,
                                           SF_CHANNEL_MAP_CENTER,
                                           SF_CHANNEL_MAP_LFE,
                                           SF_CHANNEL_MAP_REAR_LEFT,
                                           SF_CHANNEL_MAP_REAR_RIGHT,
                                           SF_CHANNEL_MAP_FRONT_LEFT_OF_CENTER,
                                           SF_CHANNEL_MAP_FRONT_RIGHT_OF_CENTER,
                                           SF_CHANNEL_MAP_REAR_CENTER,
                                           SF_CHANNEL_MAP_SIDE_LEFT,
                                           SF_CHANNEL_MAP_SIDE_RIGHT,
                                           SF_CHANNEL_MAP_TOP_CENTER,
                                           SF_CHANNEL_MAP_TOP_FRONT_LEFT,
                                           SF_CHANNEL_MAP_TOP_FRONT_CENTER,
                                           SF_CHANNEL_MAP_TOP_FRONT_RIGHT,
                                           SF_CHANNEL_MAP_TOP_REAR_LEFT,
                                           SF_CHANNEL_MAP_TOP_REAR_CENTER,
                                           SF_CHANNEL_MAP_TOP_REAR_RIGHT};

bool name_channels(SNDFILE* file, std::uint32_t channel_mask) {
  std::vector<int> map;
  for (std::size_t bit = 0; bit < kSpeakers.size(); ++bit)
    if ((channel_mask >> bit & 1u) != 0) map.push_back(kSpeakers[bit]);
  return sf_command(file, SFC_SET_CHANNEL_MAP_INFO, map.data(), static_cast<int>(map.size() * sizeof(int))) == SF_TRUE;
}

}  // namespace

std::string encode_sound(std::span<const float> channels, int num_channels, float sample_rate_hz, SoundFormat format,
                         const std::string& where, std::uint32_t channel_mask) {
  const bool is_named = format == SoundFormat::wav && channel_mask != 0;
  require(num_channels > 0 && channels.size() % static_cast<std::size_t>(num_channels) == 0, "num_channels", num_channels,
          "must divide the number of samples");
  require(format == SoundFormat::wav || num_channels <= 8, "num_channels", num_channels, "must be at most 8 in FLAC; WAV supports more");
  require(sample_rate_hz >= 1 && sample_rate_hz == std::round(sample_rate_hz) && sample_rate_hz <= 1e7f, "sample_rate_hz", sample_rate_hz,
          "must be a whole number: headers of sound files store an integer");
  require(channel_mask >> kSpeakers.size() == 0 && (channel_mask == 0 || std::popcount(channel_mask) == num_channels), "channel_mask",
          channel_mask, "must have a bit for each channel, of the lowest 18");
  if (channels.size() > (std::size_t{1} << 30) - 64) throw RunError(where, "exceeds the 4 GiB limit of WAV files");
  if (!std::all_of(channels.begin(), channels.end(), [](float value) { return std::isfinite(value); }))
    throw RunError(where, "not written: the sound has non-finite samples");
  if (format == SoundFormat::flac && !std::all_of(channels.begin(), channels.end(), [](float value) { return value >= -1 && value < 1; }))
    throw RunError(where, "not written: FLAC cannot store samples outside [-1, 1)");

  const auto width = static_cast<std::size_t>(num_channels), frames = channels.size() / width;
  std::vector<float> interleaved(channels.size());
  for (std::size_t channel = 0; channel < width; ++channel)
    for (std::size_t frame = 0; frame < frames; ++frame) interleaved[frame * width + channel] = channels[channel * frames + frame];

  MemoryFile memory;
  SF_VIRTUAL_IO io = memory_io();
  SF_INFO info{};
  info.samplerate = static_cast<int>(sample_rate_hz);
  info.channels = num_channels;
  info.format = is_named                     ? SF_FORMAT_WAVEX | SF_FORMAT_FLOAT
                : format == SoundFormat::wav ? SF_FORMAT_WAV | SF_FORMAT_FLOAT
                                             : SF_FORMAT_FLAC | SF_FORMAT_PCM_24;
  SNDFILE* file = sf_open_virtual(&io, SFM_WRITE, &info, &memory);
  if (!file) throw RunError(where, fmt::format("cannot be encoded: {}", sf_strerror(nullptr)));
  sf_command(file, SFC_SET_ADD_PEAK_CHUNK, nullptr, SF_FALSE);  // that chunk holds the time of day: same sound, same bytes
  if (is_named && !name_channels(file, channel_mask)) {
    sf_close(file);
    throw RunError(where, "cannot be encoded: the sound library takes no channel mask");
  }
  const sf_count_t written = sf_writef_float(file, interleaved.data(), static_cast<sf_count_t>(frames));
  const int closed = sf_close(file);
  if (written != static_cast<sf_count_t>(frames) || closed != 0) throw RunError(where, "cannot be encoded as a sound file");
  return std::move(memory.bytes);
}

void write_wav(const std::filesystem::path& path, std::span<const float> channels, int num_channels, float sample_rate_hz,
               std::uint32_t channel_mask) {
  write_file_atomically(path, encode_sound(channels, num_channels, sample_rate_hz, SoundFormat::wav, path.string(), channel_mask));
}

}  // namespace earshot
