#include "sim/audio/dry_sounds/sound_clip.h"

#include <fmt/format.h>
#include <sndfile.h>

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <memory>

#include "sim/audio/transforms/resample.h"
#include "sim/base/errors.h"
#include "sim/base/files.h"

namespace earshot {
namespace {

constexpr double kMaxLengthS = 600;
constexpr sf_count_t kBlockFrames = 4096;

struct CloseFile {
  void operator()(SNDFILE* file) const noexcept { sf_close(file); }
};
using SoundFile = std::unique_ptr<SNDFILE, CloseFile>;

bool rate_is_valid(double rate_hz) { return rate_hz >= kMinRateHz && rate_hz <= kMaxRateHz; }

int checked_rate(float sample_rate_hz) {
  require(rate_is_valid(sample_rate_hz) && sample_rate_hz == std::round(sample_rate_hz), "sample_rate_hz", sample_rate_hz,
          "must be a whole number in [1000, 768000]");
  return static_cast<int>(sample_rate_hz);
}

/// The whole file as one channel, the mean of all, at the rate of the file.
std::vector<float> read_mono(SNDFILE* file, const SF_INFO& info, const std::string& name) {
  const auto max_frames = static_cast<std::size_t>(kMaxLengthS * info.samplerate);
  const auto channels = static_cast<std::size_t>(info.channels);
  std::vector<float> block(static_cast<std::size_t>(kBlockFrames) * channels), mono;
  // Blocks, as the frame count of a damaged header may be anything.
  for (sf_count_t read = 0; (read = sf_readf_float(file, block.data(), kBlockFrames)) > 0;) {
    for (std::size_t frame = 0; frame < static_cast<std::size_t>(read); ++frame) {
      double sum = 0;
      for (std::size_t channel = 0; channel < channels; ++channel) sum += block[frame * channels + channel];
      const auto mean = static_cast<float>(sum / static_cast<double>(channels));
      if (!std::isfinite(mean))
        throw InputError(name, fmt::format("sample {} is not a finite number", mono.size()), "export the sound again");
      mono.push_back(mean);
    }
    if (mono.size() > max_frames) throw InputError(name, "is longer than 10 minutes", "cut the sound");
  }
  if (mono.empty()) throw InputError(name, "holds no samples", "is the file complete?");
  return mono;
}

/// Throws InputError: no such file, not audio, a rate or a number of channels that cannot be.
SoundFile open_for_reading(const std::filesystem::path& path, SF_INFO& info) {
  const std::string name = path.string();
  std::error_code error;
  const auto status = std::filesystem::status(path, error);
  if (!std::filesystem::exists(status)) throw InputError(name, "no such file", "check the path");
  if (!std::filesystem::is_regular_file(status)) throw InputError(name, "is not a file", "name a WAV, FLAC or OGG file");

  SoundFile file{sf_open(path.c_str(), SFM_READ, &info)};
  if (!file) throw InputError(name, fmt::format("cannot be read as sound ({})", sf_strerror(nullptr)), "give WAV, FLAC or OGG");
  if (!rate_is_valid(info.samplerate))
    throw InputError(name, fmt::format("has a sample rate of {} Hz, outside [1000, 768000]", info.samplerate), "correct its header");
  if (info.channels < 1) throw InputError(name, "has no channels", "correct its header");
  return file;
}

}  // namespace

SoundClip load_sound(const std::filesystem::path& path, float sample_rate_hz) {
  const int rate = checked_rate(sample_rate_hz);
  const std::string name = path.string();
  SF_INFO info{};
  const SoundFile file = open_for_reading(path, info);
  SoundClip clip{.name = path.stem().string(), .sample_rate_hz = sample_rate_hz, .samples = read_mono(file.get(), info, name)};
  if (info.samplerate != rate) clip.samples = resample(clip.samples, info.samplerate, rate, name);
  // Values near the largest float can overflow in the filter.
  if (!std::all_of(clip.samples.begin(), clip.samples.end(), [](float value) { return std::isfinite(value); }))
    throw InputError(name, "has samples too large to resample", "scale the sound to [-1, 1]");
  return clip;
}

SoundChannels load_sound_channels(const std::filesystem::path& path) {
  SF_INFO info{};
  const SoundFile file = open_for_reading(path, info);
  const auto channels = static_cast<std::size_t>(info.channels);
  std::vector<float> block(static_cast<std::size_t>(kBlockFrames) * channels), interleaved;
  const auto max_samples = static_cast<std::size_t>(kMaxLengthS * info.samplerate) * channels;
  for (sf_count_t read = 0; (read = sf_readf_float(file.get(), block.data(), kBlockFrames)) > 0;) {
    interleaved.insert(interleaved.end(), block.begin(), block.begin() + static_cast<std::ptrdiff_t>(read * info.channels));
    if (interleaved.size() > max_samples) throw InputError(path.string(), "is longer than 10 minutes", "cut the sound");
  }
  if (interleaved.empty()) throw InputError(path.string(), "holds no samples", "is the file complete?");
  if (!std::all_of(interleaved.begin(), interleaved.end(), [](float value) { return std::isfinite(value); }))
    throw InputError(path.string(), "has samples that are not finite numbers", "export the sound again");
  SoundChannels sound{info.channels, static_cast<float>(info.samplerate), std::vector<float>(interleaved.size())};
  const std::size_t frames = sound.num_frames();
  for (std::size_t channel = 0; channel < channels; ++channel)
    for (std::size_t frame = 0; frame < frames; ++frame) sound.samples[channel * frames + frame] = interleaved[frame * channels + channel];
  return sound;
}

SoundClip open_sound(const std::string& spec, float sample_rate_hz) {
  return spec.starts_with("synth:") ? synthesize_sound(spec, sample_rate_hz) : load_sound(spec, sample_rate_hz);
}

}  // namespace earshot
