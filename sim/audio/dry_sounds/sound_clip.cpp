// SPDX-License-Identifier: Apache-2.0
#include "sim/audio/dry_sounds/sound_clip.h"

#include <fmt/format.h>
#include <sndfile.h>

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <memory>
#include <span>

#include "sim/audio/dry_sounds/memory_file.h"
#include "sim/audio/dry_sounds/sound_extent.h"
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

/// A sound file that is being read.
struct OpenSound {
  std::string name;
  SF_INFO info{};
  std::uint64_t least_frames = 0;
  MemoryFile memory;  ///< its bytes with the length filled in, where its header has a placeholder
  SoundFile file;     ///< closed before the memory goes
};

bool length_can_be_checked(int format) {
  const int container = format & SF_FORMAT_TYPEMASK;
  return container == SF_FORMAT_WAV || container == SF_FORMAT_WAVEX || container == SF_FORMAT_RF64 || container == SF_FORMAT_W64 ||
         container == SF_FORMAT_AIFF || container == SF_FORMAT_SVX || container == SF_FORMAT_AU || container == SF_FORMAT_CAF ||
         container == SF_FORMAT_FLAC || container == SF_FORMAT_OGG || container == SF_FORMAT_MPEG || container == SF_FORMAT_NIST;
}

std::string container_name(int format) {
  SF_FORMAT_INFO info{};
  info.format = format & SF_FORMAT_TYPEMASK;
  return sf_command(nullptr, SFC_GET_FORMAT_INFO, &info, sizeof info) == 0 && info.name ? info.name : "an unknown container";
}

void open_file(OpenSound& sound, const std::filesystem::path& path) {
  const SoundExtent extent = read_sound_extent(path);
  sound.least_frames = extent.least_frames;
  if (extent.size_bytes.empty()) {
    sound.file.reset(sf_open(path.c_str(), SFM_READ, &sound.info));
    return;
  }
  sound.memory.bytes = read_file(path);
  if (extent.size_place + extent.size_bytes.size() <= sound.memory.bytes.size())
    sound.memory.bytes.replace(static_cast<std::size_t>(extent.size_place), extent.size_bytes.size(), extent.size_bytes);
  SF_VIRTUAL_IO io = memory_io();
  sound.file.reset(sf_open_virtual(&io, SFM_READ, &sound.info, &sound.memory));
}

/// Throws InputError: no such file, not audio, cut short, a rate or a number of channels that cannot be.
std::unique_ptr<OpenSound> open_for_reading(const std::filesystem::path& path) {
  auto sound = std::make_unique<OpenSound>();
  const std::string& name = sound->name = path.string();
  std::error_code error;
  const auto status = std::filesystem::status(path, error);
  if (!std::filesystem::exists(status)) throw InputError(name, "no such file", "check the path");
  if (!std::filesystem::is_regular_file(status)) throw InputError(name, "is not a file", "give a WAV, FLAC or OGG file");

  open_file(*sound, path);
  if (!sound->file)
    throw InputError(name, fmt::format("cannot be read as sound ({})", sf_strerror(nullptr)), "use a WAV, FLAC or OGG file");
  const SF_INFO& info = sound->info;
  if (!length_can_be_checked(info.format))
    throw InputError(name, fmt::format("is {}, a format in which a truncated file cannot be detected", container_name(info.format)),
                     "convert it to WAV or FLAC");
  if (!rate_is_valid(info.samplerate))
    throw InputError(name, fmt::format("has a sample rate of {} Hz, outside [1000, 768000]", info.samplerate), "correct its header");
  if (info.channels < 1) throw InputError(name, "has no channels", "correct its header");
  return sound;
}

/// Hands on all of the sound in blocks, interleaved.  Throws InputError: damaged, another length than stated, empty, over 10 minutes.
template <class TakeBlock>
void read_blocks(const OpenSound& sound, const TakeBlock& take) {
  const auto max_frames = static_cast<sf_count_t>(kMaxLengthS * sound.info.samplerate);
  std::vector<float> block(static_cast<std::size_t>(kBlockFrames) * static_cast<std::size_t>(sound.info.channels));
  sf_count_t total = 0;
  // Blocks, as the frame count of a damaged header may be anything.
  while (true) {
    const sf_count_t count = sf_readf_float(sound.file.get(), block.data(), kBlockFrames);
    if (const int error = sf_error(sound.file.get()))
      throw InputError(sound.name, fmt::format("is damaged after sample {} ({})", total, sf_error_number(error)),
                       "copy or export the sound again");
    if (count <= 0) break;
    total += count;
    if (total > max_frames) throw InputError(sound.name, "is longer than 10 minutes", "shorten the sound");
    take(std::span<const float>(block).first(static_cast<std::size_t>(count * sound.info.channels)));
  }
  if (total == 0) throw InputError(sound.name, "contains no samples", "check that the file is complete");
  const bool is_stated = sound.info.frames > 0 && sound.info.frames < SF_COUNT_MAX;
  const auto stated = is_stated ? static_cast<std::uint64_t>(sound.info.frames) : sound.least_frames;
  const auto read = static_cast<std::uint64_t>(total);
  if ((is_stated && read != stated) || read < sound.least_frames)
    throw InputError(sound.name, fmt::format("is damaged: only {} of {} samples can be read", read, std::max(stated, sound.least_frames)),
                     "copy or export the sound again");
}

/// The whole file as one channel, the mean of all, at the rate of the file.
std::vector<float> read_mono(const OpenSound& sound) {
  const auto channels = static_cast<std::size_t>(sound.info.channels);
  std::vector<float> mono;
  read_blocks(sound, [&](std::span<const float> block) {
    for (std::size_t first = 0; first < block.size(); first += channels) {
      double sum = 0;
      for (std::size_t channel = 0; channel < channels; ++channel) sum += static_cast<double>(block[first + channel]);
      const auto mean = static_cast<float>(sum / static_cast<double>(channels));
      if (!std::isfinite(mean))
        throw InputError(sound.name, fmt::format("sample {} is not a finite number", mono.size()), "export the sound again");
      mono.push_back(mean);
    }
  });
  return mono;
}

}  // namespace

SoundClip load_sound(const std::filesystem::path& path, float sample_rate_hz) {
  const int rate = checked_rate(sample_rate_hz);
  const std::string name = path.string();
  const auto sound = open_for_reading(path);
  SoundClip clip{.name = path.stem().string(), .sample_rate_hz = sample_rate_hz, .samples = read_mono(*sound)};
  if (sound->info.samplerate != rate) clip.samples = resample(clip.samples, sound->info.samplerate, rate, name);
  // Values near the largest float can overflow in the filter.
  if (!std::all_of(clip.samples.begin(), clip.samples.end(), [](float value) { return std::isfinite(value); }))
    throw InputError(name, "has samples too large to resample", "scale the sound to [-1, 1]");
  return clip;
}

SoundChannels load_sound_channels(const std::filesystem::path& path) {
  const auto file = open_for_reading(path);
  const auto channels = static_cast<std::size_t>(file->info.channels);
  std::vector<float> interleaved;
  read_blocks(*file, [&](std::span<const float> block) { interleaved.insert(interleaved.end(), block.begin(), block.end()); });
  if (!std::all_of(interleaved.begin(), interleaved.end(), [](float value) { return std::isfinite(value); }))
    throw InputError(path.string(), "has non-finite samples", "export the sound again");
  SoundChannels sound{file->info.channels, static_cast<float>(file->info.samplerate), std::vector<float>(interleaved.size())};
  const std::size_t frames = sound.num_frames();
  for (std::size_t channel = 0; channel < channels; ++channel)
    for (std::size_t frame = 0; frame < frames; ++frame) sound.samples[channel * frames + frame] = interleaved[frame * channels + channel];
  return sound;
}

SoundClip open_sound(const std::string& spec, float sample_rate_hz) {
  return spec.starts_with("synth:") ? synthesize_sound(spec, sample_rate_hz) : load_sound(spec, sample_rate_hz);
}

}  // namespace earshot
