// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <span>
#include <string>

namespace earshot {

/// wav: 32-bit float, any level.  flac: 24-bit integers, full scale at 1.
enum class SoundFormat { wav, flac };

/// The bytes of a sound file, channels from [num_channels, n]: the same sound, the same bytes.  where: how messages name it.  Throws
/// InputError for sizes or rates that do not fit, and for more than 8 channels in FLAC; RunError for samples that are not finite, and in
/// FLAC for samples outside [-1, 1).
/// channel_mask: loudspeakers of the channels, dwChannelMask of WAVEFORMATEXTENSIBLE with one of the lowest 18 bits a channel; 0: none, a
/// plain header.  FLAC has none.
std::string encode_sound(std::span<const float> channels, int num_channels, float sample_rate_hz, SoundFormat format,
                         const std::string& where, std::uint32_t channel_mask = 0);

/// The ending of such files, with the dot.
inline const char* ending_of(SoundFormat format) { return format == SoundFormat::wav ? ".wav" : ".flac"; }

}  // namespace earshot
