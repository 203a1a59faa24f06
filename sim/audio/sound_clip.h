#pragma once

#include <filesystem>
#include <span>
#include <string>
#include <vector>

namespace earshot {

/// A dry mono sound.
struct SoundClip {
  std::string name;
  float sample_rate_hz = 0;
  std::vector<float> samples;
};

/// Reads WAV, FLAC or OGG (libsndfile), averages channels, resamples to `sample_rate_hz` (libswresample).  Throws InputError: missing,
/// not audio, empty, non-finite samples, rate outside [1000, 768000], longer than 10 minutes.
SoundClip load_sound(const std::filesystem::path& path, float sample_rate_hz);

/// Seeded synthetic sounds so that training needs no files: "synth:KIND[:SEED]" with KIND = telephone, alarm, music, noise, speech, click,
/// engine, bird.  One to three seconds, peak 0.5, loops without a click.
SoundClip synthesize_sound(const std::string& spec, float sample_rate_hz);

/// `synth:...` or a file path.
SoundClip open_sound(const std::string& spec, float sample_rate_hz);

/// Writes 32-bit float WAV, channels interleaved from [num_channels, n], atomically.
void write_wav(const std::filesystem::path& path, std::span<const float> channels, int num_channels, float sample_rate_hz);

}  // namespace earshot
