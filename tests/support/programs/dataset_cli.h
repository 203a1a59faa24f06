// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <sys/wait.h>

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <cstdlib>
#include <filesystem>
#include <string>
#include <vector>

#include "sim/audio/dry_sounds/sound_clip.h"
#include "sim/base/files.h"
#include "tests/support/envs/env_cases.h"
#include "tests/support/envs/rir_corpus_cases.h"
#include "tests/support/files/test_paths.h"

namespace earshot {

/// Noise of a level that nothing but its seed decides, by a generator of its own.
inline std::vector<float> noise_of(std::uint64_t seed, std::size_t samples) {
  std::vector<float> sound(samples);
  std::uint64_t state = 6364136223846793005u * (seed + 1) + 1442695040888963407u;
  for (float& sample : sound) {
    state = 6364136223846793005u * state + 1442695040888963407u;
    sample = static_cast<float>(static_cast<double>(state >> 40) / double{1 << 24} - 0.5) * 0.4f;
  }
  return sound;
}

/// `earshot dataset` as a user runs it, in a folder with a small corpus of responses.
class DatasetCli : public testing::Test {
 protected:
  static constexpr int kRateHz = 8000;

  explicit DatasetCli(const std::string& name = "dataset_cli") : folder_(name) {
    write_text(path("rir.yaml"),
               "seed: 3\nshoeboxes: {count: 2, max_size_m: [5, 3, 5]}\nsources_per_room: 3\nlisteners_per_source: 3\nrooms_per_folder: 1\n"
               "shared_listeners: true\nchannels: mono\nacoustics: {rays: 16, rir_length_s: 0.05, sample_rate_hz: 8000}\n");
    EXPECT_EQ(dataset("rir " + path("rir.yaml") + " --out " + path("corpus")).exit_code, 0);
    std::filesystem::create_directories(path("speech"));
  }
  [[nodiscard]] std::string path(const std::string& name) const { return (folder_.path() / name).string(); }
  /// A speech file of noise.
  void speak(const std::string& name, std::uint64_t seed, std::size_t samples) const {
    std::filesystem::create_directories(std::filesystem::path(path("speech/" + name)).parent_path());
    write_wav(path("speech/" + name), noise_of(seed, samples), 1, kRateHz);
  }
  struct Outcome {
    int exit_code = -1;
    std::string text;
  };
  [[nodiscard]] Outcome dataset(const std::string& arguments) const {
    const std::string command = earshot_program().string() + " dataset " + arguments + " >" + path("output") + " 2>&1";
    const int status = std::system(command.c_str());
    return {WIFEXITED(status) ? WEXITSTATUS(status) : -1, read_file(path("output"))};
  }
  /// `more`: further options.
  [[nodiscard]] Outcome convolve(const std::string& out, const std::string& more = "") const {
    return dataset("convolve " + path("corpus") + " --speech " + path("speech") + " --threads 2 --out " + path(out) + " " + more);
  }
  /// Of one line, which names what is wrong; nothing is written.
  void expect_refused(const Outcome& outcome, const std::string& text, const std::string& out) const {
    EXPECT_EQ(outcome.exit_code, 2) << outcome.text;
    EXPECT_THAT(outcome.text, testing::HasSubstr(text));
    EXPECT_EQ(std::ranges::count(outcome.text, '\n'), 1) << outcome.text;
    EXPECT_FALSE(std::filesystem::exists(path(out))) << text;
  }
  [[nodiscard]] std::vector<nlohmann::json> lines(const std::string& file) const { return corpus_cases::lines_of(path(file)); }
  [[nodiscard]] std::vector<float> sound(const std::string& out, const nlohmann::json& file) const {
    return corpus_cases::read_float_wav(read_file(folder_.path() / out / file.get<std::string>())).channels.at(0);
  }
  [[nodiscard]] static double energy(const std::vector<float>& samples, std::size_t from = 0) {
    double sum = 0;
    for (std::size_t i = from; i < samples.size(); ++i) sum += static_cast<double>(samples[i]) * static_cast<double>(samples[i]);
    return sum;
  }

  TestFolder folder_;
};

}  // namespace earshot
