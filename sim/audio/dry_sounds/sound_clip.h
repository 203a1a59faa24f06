// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <filesystem>
#include <span>
#include <string>
#include <vector>

namespace earshot {

/// A dry mono sound.
struct SoundClip {
  std::string name;
  float sample_rate_hz = 0;
  std::vector<float> samples;  ///< finite
};

/// Reads WAV, W64, AIFF, 8SVX, AU, CAF, NIST SPHERE, FLAC, Ogg or MP3 (libsndfile), averages channels, resamples to `sample_rate_hz`
/// (resample.h).  A sound comes whole: headers with a placeholder for the length (sound_extent.h) are read to the end of the file.  Throws
/// InputError: missing, not audio, another container, shorter or longer than its header states, damaged, empty, non-finite samples, rate
/// outside [1000, 768000], longer than 10 minutes.
SoundClip load_sound(const std::filesystem::path& path, float sample_rate_hz);

/// The channels of a sound file as they are, at its own rate.
struct SoundChannels {
  int num_channels = 0;
  float sample_rate_hz = 0;
  std::vector<float> samples;  ///< [num_channels, n], finite
  [[nodiscard]] std::size_t num_frames() const { return samples.size() / static_cast<std::size_t>(num_channels); }
  [[nodiscard]] std::span<const float> channel(int index) const {
    return std::span(samples).subspan(static_cast<std::size_t>(index) * num_frames(), num_frames());
  }
};

/// Reads them.  Throws InputError as load_sound.
SoundChannels load_sound_channels(const std::filesystem::path& path);

/// Seeded synthetic sounds so that training needs no files: "synth:KIND[:SEED]" with KIND = telephone, alarm, music, noise, speech, click,
/// engine, bird.  One to three seconds, peak 0.5, loops without a click.  Throws InputError for an unknown kind or a bad seed.
SoundClip synthesize_sound(const std::string& spec, float sample_rate_hz);

/// synthesize_sound for `synth:...`, load_sound for anything else.
SoundClip open_sound(const std::string& spec, float sample_rate_hz);

/// Writes 32-bit float WAV, channels interleaved from [num_channels, n], atomically.  Throws InputError for sizes that do not fit, RunError
/// if the file cannot be written.  channel_mask: as encode_sound (sound_file.h).
void write_wav(const std::filesystem::path& path, std::span<const float> channels, int num_channels, float sample_rate_hz,
               std::uint32_t channel_mask = 0);

}  // namespace earshot
