// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <filesystem>
#include <span>
#include <string>
#include <vector>

#include "sim/base/random.h"

namespace earshot {

/// Sound files of a folder and those below it, by the order of their paths, which are relative to it.
struct SoundFolder {
  std::filesystem::path root;
  std::vector<std::string> files;
  /// Links are followed; one that leads nowhere is listed if its name is that of a sound.  Throws InputError: none is there, a folder that
  /// cannot be read or that holds itself by a link.
  static SoundFolder list(const std::string& folder);
  /// Of names and sizes.  Throws InputError for a file that is gone.
  [[nodiscard]] std::uint64_t hash() const;
};

/// Bytes of a sound file.  Throws InputError if it cannot be read.
std::uint64_t sound_file_size(const std::filesystem::path& file);

/// Most of a sample of what is written: below 1 with 24 bits.
inline constexpr double kMaxPeak = 0.999;

/// range: [low, high]; fraction in [0, 1).  To the hundredth, so that a manifest shows all of it.
double within_range(const std::vector<float>& range, float fraction);
double amplitude_of_db(double db);
double energy_of(std::span<const float> samples);
double peak_of(std::span<const float> samples);
/// Of the first of the loudest samples.
std::size_t loudest_sample(std::span<const float> samples);
void scale(std::vector<float>& samples, double factor);
/// `count` samples of an endless loop of `clip`, from `start` on.
std::vector<float> looped(std::span<const float> clip, std::uint64_t start, std::size_t count);
/// Where a loop of `clip` begins so that something sounds in `frames` samples from the `heard`-th on: at `drawn`; or, where that part is
/// silent, so that the loudest sample sounds `lag` samples into it.  lag: below frames.
std::uint64_t sounding_start(std::span<const float> clip, std::uint64_t drawn, std::size_t heard, std::size_t frames, std::size_t lag);
/// Normal numbers of unit variance.
std::vector<float> white_noise(const RandomStream& random, std::size_t count);

}  // namespace earshot
