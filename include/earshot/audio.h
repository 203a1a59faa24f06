// SPDX-License-Identifier: Apache-2.0
#pragma once

/// @file
/// Sounds: load, convolve with a response, write.

#include <cstddef>
#include <cstdint>
#include <filesystem>
#include <span>
#include <string>
#include <vector>

#include "earshot/rir.h"

namespace earshot::api {

/// Sound of one or more channels.
struct Audio {
  int num_channels = 0;
  double sample_rate_hz = 0;
  std::vector<float> samples;      ///< [num_channels, num_frames()], finite
  std::uint32_t channel_mask = 0;  ///< as Rir::channel_mask

  [[nodiscard]] std::size_t num_frames() const { return num_channels == 0 ? 0 : samples.size() / static_cast<std::size_t>(num_channels); }
  [[nodiscard]] std::span<const float> channel(int index) const {
    return std::span(samples).subspan(static_cast<std::size_t>(index) * num_frames(), num_frames());
  }
};

/// A dry sound, one channel: a sound file, whose channels are averaged, or `synth:KIND[:SEED]` with KIND = telephone, alarm, music, noise,
/// speech, click, engine, bird (one to three seconds, peak 0.5).  Resampled to `sample_rate_hz`.
///
/// Formats: WAV, W64, AIFF, 8SVX, AU, CAF, NIST SPHERE, FLAC, Ogg, MP3.
/// @throws InputError for a missing, damaged, empty or overlong file (10 minutes), or an unknown kind.
Audio load_sound(const std::string& spec, double sample_rate_hz);

/// The channels of a sound file as they are, at the file's own rate.
/// @throws InputError as load_sound.
Audio load_audio(const std::filesystem::path& path);

/// A dry sound as heard through a response: [rir.num_channels, frames + rir.num_samples - 1].
/// @param dry  one channel at the rate of the response.
/// @param rir  any number of channels.
/// @throws InputError if the rates differ, or `dry` has several channels.
Audio convolve(const Audio& dry, const Rir& rir);

/// Writes a WAV file of 32-bit floats, whole or not at all.
/// @throws RunError if the file cannot be written.
void write_wav(const std::filesystem::path& path, const Audio& audio);
void write_wav(const std::filesystem::path& path, const Rir& rir);

}  // namespace earshot::api
