// SPDX-License-Identifier: Apache-2.0
#include "datasets/corpus_sounds.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <set>
#include <system_error>

#include "sim/base/errors.h"
#include "sim/base/files.h"

namespace earshot {
namespace {

/// Folders within folders: more are those of a link that leads back.
constexpr int kDeepest = 40;

bool names_sound(const std::filesystem::path& path) {
  static const std::set<std::string> endings{".wav", ".flac", ".ogg", ".oga", ".opus", ".mp3",
                                             ".aif", ".aiff", ".au",  ".caf", ".w64",  ".sph"};
  std::string ending = path.extension().string();
  std::ranges::transform(ending, ending.begin(), [](char c) { return c >= 'A' && c <= 'Z' ? static_cast<char>(c - 'A' + 'a') : c; });
  return endings.contains(ending);
}

}  // namespace

SoundFolder SoundFolder::list(const std::string& folder) {
  std::error_code error;
  if (!std::filesystem::is_directory(folder, error)) throw InputError(folder, "is not a folder", "give a folder with sound files");
  SoundFolder found{.root = folder, .files = {}};
  std::filesystem::recursive_directory_iterator at(folder, std::filesystem::directory_options::follow_directory_symlink, error);
  for (; !error && at != std::filesystem::recursive_directory_iterator(); at.increment(error)) {
    if (at.depth() > kDeepest)
      throw InputError(folder, fmt::format("has more than {} nested folders", kDeepest),
                       "look for a symbolic link that leads back to a parent folder");
    std::error_code unknown;
    const bool is_dangling = at->is_symlink(unknown) && !at->exists(unknown);
    if (!names_sound(at->path()) || (!is_dangling && !at->is_regular_file(unknown))) continue;
    found.files.push_back(at->path().lexically_relative(folder).generic_string());
  }
  if (error) throw InputError(folder, "cannot be listed: " + error.message(), "check the permissions and links of its folders");
  if (found.files.empty()) throw InputError(folder, "contains no sound file", "give a folder with WAV, FLAC, OGG, Opus, MP3 or AIFF files");
  std::ranges::sort(found.files);
  return found;
}

std::uint64_t SoundFolder::hash() const {
  std::string text;
  for (const std::string& file : files) text += fmt::format("{} {}\n", file, sound_file_size(root / file));
  return hash64(text);
}

std::uint64_t sound_file_size(const std::filesystem::path& file) {
  std::error_code error;
  const std::uintmax_t bytes = std::filesystem::file_size(file, error);
  if (error) throw InputError(file.string(), "cannot be read: " + error.message(), "check the path");
  return bytes;
}

double within_range(const std::vector<float>& range, float fraction) {
  const auto low = static_cast<double>(range[0]), high = static_cast<double>(range[1]);
  return 0.01 * std::round(100.0 * (low + static_cast<double>(fraction) * (high - low)));
}

double amplitude_of_db(double db) { return std::pow(10, db / 20); }

double energy_of(std::span<const float> samples) {
  double sum = 0;
  for (const float sample : samples) sum += static_cast<double>(sample) * static_cast<double>(sample);
  return sum;
}

double peak_of(std::span<const float> samples) {
  float peak = 0;
  for (const float sample : samples) peak = std::max(peak, std::abs(sample));
  return static_cast<double>(peak);
}

std::size_t loudest_sample(std::span<const float> samples) {
  std::size_t loudest = 0;
  for (std::size_t i = 0; i < samples.size(); ++i)
    if (std::abs(samples[i]) > std::abs(samples[loudest])) loudest = i;
  return loudest;
}

void scale(std::vector<float>& samples, double factor) {
  for (float& sample : samples) sample *= static_cast<float>(factor);
}

std::vector<float> looped(std::span<const float> clip, std::uint64_t start, std::size_t count) {
  std::vector<float> result(count);
  for (std::size_t i = 0; i < count; ++i) result[i] = clip[static_cast<std::size_t>((start + i) % clip.size())];
  return result;
}

std::uint64_t sounding_start(std::span<const float> clip, std::uint64_t drawn, std::size_t heard, std::size_t frames, std::size_t lag) {
  if (energy_of(looped(clip, drawn + heard, frames)) > 0) return drawn;
  return (loudest_sample(clip) + clip.size() - (heard + lag) % clip.size()) % clip.size();
}

std::vector<float> white_noise(const RandomStream& random, std::size_t count) {
  std::vector<float> noise(count);
  for (std::size_t i = 0; i < count; i += 2) {
    const auto pair = random.normal2(static_cast<std::uint32_t>(i / 2));
    noise[i] = pair[0];
    if (i + 1 < count) noise[i + 1] = pair[1];
  }
  return noise;
}

}  // namespace earshot
