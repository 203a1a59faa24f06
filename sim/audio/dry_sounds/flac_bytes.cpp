// SPDX-License-Identifier: Apache-2.0
#include "sim/audio/dry_sounds/flac_bytes.h"

#include <fmt/format.h>
#include <sndfile.h>

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <vector>

#include "sim/audio/dry_sounds/memory_file.h"
#include "sim/base/errors.h"

namespace earshot {

std::string flac_bytes(std::span<const float> channels, int num_channels, float sample_rate_hz) {
  require(num_channels > 0 && num_channels <= 8 && channels.size() % static_cast<std::size_t>(num_channels) == 0, "num_channels",
          num_channels, "must be at most 8 and divide the number of samples");
  require(sample_rate_hz >= 1 && sample_rate_hz == std::round(sample_rate_hz) && sample_rate_hz <= 655350.f, "sample_rate_hz",
          sample_rate_hz, "must be a whole number that FLAC supports");
  if (!std::all_of(channels.begin(), channels.end(), [](float value) { return std::isfinite(value); }))
    throw RunError("sound", "cannot be encoded: it has non-finite samples");
  const auto width = static_cast<std::size_t>(num_channels), frames = channels.size() / width;
  std::vector<std::int16_t> interleaved(channels.size());
  for (std::size_t channel = 0; channel < width; ++channel)
    for (std::size_t frame = 0; frame < frames; ++frame)
      interleaved[frame * width + channel] =
          static_cast<std::int16_t>(std::lround(32767.f * std::clamp(channels[channel * frames + frame], -1.f, 1.f)));

  MemoryFile memory;
  SF_VIRTUAL_IO io = memory_io();
  SF_INFO info{};
  info.samplerate = static_cast<int>(sample_rate_hz);
  info.channels = num_channels;
  info.format = SF_FORMAT_FLAC | SF_FORMAT_PCM_16;
  SNDFILE* file = sf_open_virtual(&io, SFM_WRITE, &info, &memory);
  if (!file) throw RunError("sound", fmt::format("cannot be encoded as FLAC: {}", sf_strerror(nullptr)));
  const sf_count_t written = sf_writef_short(file, interleaved.data(), static_cast<sf_count_t>(frames));
  const int closed = sf_close(file);
  if (written != static_cast<sf_count_t>(frames) || closed != 0) throw RunError("sound", "cannot be encoded as FLAC");
  return memory.bytes;
}

}  // namespace earshot
