// SPDX-License-Identifier: Apache-2.0
// `earshot dataset convolve`, `scenes`, `pano`, SOFA files, and the template of Slurm, as a user runs them.

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <png.h>
#include <sys/wait.h>

#include <algorithm>
#include <cmath>
#include <complex>
#include <cstdlib>
#include <numbers>
#include <string>
#include <utility>
#include <vector>

#include "sim/audio/transforms/fft.h"
#include "sim/base/files.h"
#include "sim/base/text/json.h"
#include "tests/support/envs/env_cases.h"
#include "tests/support/envs/rir_corpus_cases.h"
#include "tests/support/files/test_data.h"
#include "tests/support/files/test_paths.h"

namespace earshot {
namespace {

using corpus_cases::differences;
using corpus_cases::lines_of;
using corpus_cases::read_float_wav;
using corpus_cases::tree;
using testing::HasSubstr;

class DatasetCorporaCli : public testing::Test {
 protected:
  DatasetCorporaCli() {
    write_text(path("rir.yaml"),
               "seed: 3\nshoeboxes: {count: 2, max_size_m: [5, 3, 5]}\nsources_per_room: 2\nlisteners_per_source: 3\nrooms_per_folder: 1\n"
               "shared_listeners: true\nacoustics: {rays: 16, rir_length_s: 0.2}\n");
  }
  [[nodiscard]] std::string path(const std::string& name) const { return (folder_.path() / name).string(); }
  struct Outcome {
    int exit_code = -1;
    std::string text;
  };
  [[nodiscard]] Outcome shell(const std::string& command) const {
    const int status = std::system((command + " >" + path("output") + " 2>&1").c_str());
    return {WIFEXITED(status) ? WEXITSTATUS(status) : -1, read_file(path("output"))};
  }
  [[nodiscard]] Outcome dataset(const std::string& arguments) const { return shell(earshot_program().string() + " dataset " + arguments); }
  void expect_refused(const std::string& arguments, const std::string& text) const {
    const Outcome outcome = dataset(arguments);
    EXPECT_EQ(outcome.exit_code, 2) << outcome.text;
    EXPECT_THAT(outcome.text, HasSubstr(text));
    EXPECT_EQ(std::ranges::count(outcome.text, '\n'), 1) << outcome.text;
  }
  TestFolder folder_{"dataset_corpora_cli"};
};

TEST_F(DatasetCorporaCli, SpeechThroughACorpusByShardsOfTheTemplate) {
  ASSERT_EQ(dataset("rir " + path("rir.yaml") + " --out " + path("corpus")).exit_code, 0);
  std::filesystem::create_directory(path("speech"));
  for (const char* seed : {"1", "2"}) {
    const SoundClip clip = synthesize_sound(std::string("synth:engine:") + seed, 16000);
    write_wav(path("speech/") + seed + ".wav", clip.samples, 1, 16000);
  }
  const std::string signals = "convolve " + path("corpus") + " --speech " + path("speech") +
                              " --count 6 --signals-per-folder 2 --noise synth --snr -5,5 --talkers 1,2 --dry --out ";
  const Outcome whole = dataset(signals + path("whole"));
  ASSERT_EQ(whole.exit_code, 0) << whole.text;
  EXPECT_THAT(whole.text, HasSubstr("complete, 6 signals"));
  // Each task of the array as Slurm would start it.
  const std::string script = (source_dir() / "configs/launch/dataset.sbatch").string();
  for (const char* task : {"2", "1"}) {
    const Outcome part = shell("EARSHOT=" + earshot_program().string() + " SLURM_ARRAY_TASK_COUNT=2 SLURM_ARRAY_TASK_ID=" + task +
                               " bash " + script + " " + signals + path("parts"));
    EXPECT_EQ(part.exit_code, 0) << part.text;
  }
  EXPECT_EQ(differences(tree(folder_.path() / "parts"), tree(folder_.path() / "whole")), std::vector<std::string>{});
  EXPECT_EQ(shell("SLURM_ARRAY_TASK_COUNT=2 SLURM_ARRAY_TASK_ID=3 bash " + script + " rir").exit_code, 2);

  expect_refused(signals + path("refused") + " --early", "split_ms");
  expect_refused("convolve " + path("none") + " --speech " + path("speech") + " --out " + path("refused"), "contains no corpus.json");
  expect_refused("convolve " + path("corpus") + " --speech " + path("speech") + " --snr loud --out " + path("refused"), "--snr loud");
  expect_refused("convolve " + path("corpus") + " --speech " + path("speech") + " --talkers 1e30 --out " + path("refused"), "--talkers");
  EXPECT_FALSE(std::filesystem::exists(path("refused")));
  expect_refused(signals + path("whole") + " --seed 9", "'seed: 0' there, 'seed: 9' here");
}

/// Lag of the second sound in samples, and the largest difference of samples as a fraction of the peak.  A lag is that of
/// the phase, by least squares weighted with the energy.
struct Lag {
  double samples = 0, difference = 0;
};
Lag lag_of(const std::vector<float>& first, const std::vector<float>& second) {
  RealFft fft(next_power_of_two(static_cast<int>(first.size())));
  std::vector<std::complex<float>> a(static_cast<std::size_t>(fft.num_bins())), b(a.size());
  fft.forward(first, a);
  fft.forward(second, b);
  double slope = 0, weight = 0, peak = 0;
  Lag lag;
  for (std::size_t k = 1; k < a.size(); ++k) {
    const std::complex<double> cross = std::conj(std::complex<double>(b[k])) * std::complex<double>(a[k]);
    const double omega = 2 * std::numbers::pi * static_cast<double>(k) / fft.size();
    slope += std::abs(cross) * omega * std::arg(cross);
    weight += std::abs(cross) * omega * omega;
  }
  for (std::size_t n = 0; n < first.size(); ++n) {
    peak = std::max(peak, std::abs(static_cast<double>(first[n])));
    lag.difference = std::max(lag.difference, std::abs(static_cast<double>(first[n]) - static_cast<double>(second[n])));
  }
  lag.samples = slope / weight;
  lag.difference /= peak;
  return lag;
}

// In the open a talker's signal and its dry target are the same samples, however far the source.
TEST_F(DatasetCorporaCli, DryAndWetAreTheSameSamplesInTheOpen) {
  std::filesystem::create_directory(path("speech"));
  write_wav(path("speech/a.wav"), synthesize_sound("synth:noise", 16000).samples, 1, 16000);
  std::vector<std::pair<std::string, std::string>> runs;  // config, speech
  for (const char* rate : {"16000", "24000", "48000"}) {
    const std::string config = path(std::string("open") + rate + ".yaml");
    write_text(config,
               std::string("seed: ") + rate +
                   "\nshoeboxes: {count: 3, min_size_m: [3, 3, 3], max_size_m: [60, 9, 60], absorption: [1, 1]}\nsources_per_room: 2\n"
                   "listeners_per_source: 3\nshared_listeners: true\nchannels: mono\nacoustics: {preset: fast, sample_rate_hz: " +
                   rate + ", rir_length_s: 0.4, air_absorption: off}\n");
    runs.emplace_back(config, path("speech"));
  }
  const std::filesystem::path given = data_folder() / "field";
  if (std::filesystem::exists(given / "c30.yaml")) runs.emplace_back((given / "c30.yaml").string(), (given / "c30_speech").string());
  std::size_t compared = 0;
  for (const auto& [config, speech] : runs) {
    std::filesystem::remove_all(path("corpus"));
    std::filesystem::remove_all(path("out"));
    ASSERT_EQ(dataset("rir " + config + " --out " + path("corpus")).exit_code, 0);
    const Outcome made =
        dataset("convolve " + path("corpus") + " --speech " + speech + " --count 8 --dry --stems --talkers 1,2 --out " + path("out"));
    ASSERT_EQ(made.exit_code, 0) << made.text;
    const auto sound = [&](const nlohmann::json& file) {
      return read_float_wav(read_file(folder_.path() / "out" / file.get<std::string>())).channels.at(0);
    };
    for (const auto& line : lines_of(path("out/manifest.jsonl"))) {
      for (const auto& talker : line["talkers"]) {
        const std::vector<float> wet = sound(talker["file"]), dry = sound(talker["dry_file"]);
        ASSERT_EQ(wet.size(), dry.size());
        const Lag lag = lag_of(wet, dry);
        EXPECT_LT(std::abs(lag.samples), 0.01) << talker;
        EXPECT_LT(lag.difference, 2e-3) << talker;
        ++compared;
      }
    }
  }
  EXPECT_GE(compared, 24u);
}

TEST_F(DatasetCorporaCli, SofaFilesAreTheSameTwice) {
  const Outcome first = dataset("rir " + path("rir.yaml") + " --sofa --threads 1 --out " + path("first"));
  if (first.exit_code == 2 && first.text.find("has no HDF5") != std::string::npos) GTEST_SKIP() << first.text;
  ASSERT_EQ(first.exit_code, 0) << first.text;
  ASSERT_EQ(dataset("rir " + path("rir.yaml") + " --set sofa=true --threads 3 --out " + path("second")).exit_code, 0);
  const auto files = tree(folder_.path() / "first");
  EXPECT_EQ(differences(files, tree(folder_.path() / "second")), std::vector<std::string>{});
  EXPECT_TRUE(files.contains("00001/000001_s01.sofa"));
  EXPECT_FALSE(files.contains("recordings.jsonl"));
  EXPECT_EQ(files.at("00000/000000_s00.sofa").substr(0, 8), "\x89HDF\r\n\x1a\n");
  expect_refused("rir " + path("rir.yaml") + " --sofa --set split_ms=20 --out " + path("refused"), "split_ms");
}

TEST_F(DatasetCorporaCli, ScenesThatShipAreRead) {
  const Outcome outcome =
      dataset("scenes " + (source_dir() / "configs/datasets/scenes.yaml").string() +
              " --set shoeboxes.count=1 --set 'scenes=[]' --set recordings_per_room=1 --set duration_s=4 --out " + path("scenes"));
  ASSERT_EQ(outcome.exit_code, 0) << outcome.text;
  const auto lines = lines_of(path("scenes/manifest.jsonl"));
  ASSERT_EQ(lines.size(), 1u);
  EXPECT_EQ(read_float_wav(read_file(folder_.path() / "scenes" / lines[0]["file"].get<std::string>())).channels.size(), 4u);
  EXPECT_FALSE(read_file(folder_.path() / "scenes" / lines[0]["metadata_file"].get<std::string>()).empty());
}

TEST_F(DatasetCorporaCli, WhatARunCannotDoLeavesNoFolder) {
  ASSERT_EQ(dataset("rir " + path("rir.yaml") + " --out " + path("corpus")).exit_code, 0);
  std::filesystem::create_directory(path("speech"));
  write_wav(path("speech/1.wav"), synthesize_sound("synth:engine:1", 16000).samples, 1, 16000);
  const std::string scenes = (source_dir() / "configs/datasets/scenes.yaml").string();
  for (const std::string& corpus : {"rir " + path("rir.yaml"), "convolve " + path("corpus") + " --speech " + path("speech") + " --count 2",
                                    "scenes " + scenes, std::string("pano shoebox:6x3x4@0.3 --pairs 1 --size 16x8")}) {
    expect_refused(corpus + " --threads -1 --out " + path("refused"), "--threads");
    expect_refused(corpus + " --shard 3/2 --out " + path("refused"), "K from 1 to N");
    EXPECT_FALSE(std::filesystem::exists(path("refused"))) << corpus;
  }
}

// A preset names neither rate nor length; --set does.
TEST_F(DatasetCorporaCli, PanoramasKeepRateAndLengthWithAPreset) {
  const std::string pano = "pano shoebox:6x3x4@0.3 --pairs 1 --size 16x8 --rate 16000 --length 0.1 --set acoustics.preset=fast ";
  ASSERT_EQ(dataset(pano + "--out " + path("preset")).exit_code, 0);
  EXPECT_EQ(lines_of(path("preset/recordings.jsonl")).at(0)["num_samples"], 1600);
  EXPECT_EQ(lines_of(path("preset/recordings.jsonl")).at(0)["sampling_rate"], 16000);
  ASSERT_EQ(dataset(pano + "--set acoustics.rir_length_s=0.2 --out " + path("set")).exit_code, 0);
  EXPECT_EQ(lines_of(path("set/recordings.jsonl")).at(0)["num_samples"], 3200);
  const Outcome sofa = dataset(pano + "--set sofa=true --out " + path("sofa"));
  if (sofa.exit_code == 2 && sofa.text.find("has no HDF5") != std::string::npos) return;
  ASSERT_EQ(sofa.exit_code, 0) << sofa.text;
  EXPECT_TRUE(tree(path("sofa")).contains("00000/000000_s00.sofa"));
}

std::vector<std::uint16_t> read_grey16(const std::string& bytes, int& width, int& height) {
  png_image image{};
  image.version = PNG_IMAGE_VERSION;
  if (png_image_begin_read_from_memory(&image, bytes.data(), bytes.size()) == 0) return {};
  image.format = PNG_FORMAT_LINEAR_Y;
  width = static_cast<int>(image.width);
  height = static_cast<int>(image.height);
  std::vector<std::uint16_t> pixels(static_cast<std::size_t>(width) * static_cast<std::size_t>(height));
  png_image_finish_read(&image, nullptr, pixels.data(), 0, nullptr);
  return pixels;
}

// In an empty box distances are known: of the column that looks where the label says the source is, and of all around.
TEST_F(DatasetCorporaCli, PanoramasShowTheRoomOfTheResponse) {
  const Outcome outcome =
      dataset("pano shoebox:6x3x4@0.3 house:3,rooms=1,area_m2=20 --pairs 3 --size 128x48 --rate 16000 --length 0.1 --out " + path("pano"));
  ASSERT_EQ(outcome.exit_code, 0) << outcome.text;
  const auto lines = lines_of(path("pano/manifest.jsonl"));
  ASSERT_EQ(lines.size(), 6u);
  for (std::size_t i = 0; i < 3; ++i) {
    int width = 0, height = 0;
    const auto depth = read_grey16(read_file(folder_.path() / "pano" / lines[i]["depth_file"].get<std::string>()), width, height);
    ASSERT_EQ(width, 128);
    ASSERT_EQ(height, 48);
    const double x = lines[i]["listener"]["position_m"][0], y = lines[i]["listener"]["position_m"][1],
                 z = lines[i]["listener"]["position_m"][2];
    const double heading = lines[i]["listener"]["heading_deg"].get<double>() * std::numbers::pi / 180;
    for (int column = 0; column < width; ++column) {
      // Columns run from left to right, ahead in the middle; the row below the middle looks down by half a pixel.
      const double pixel = 2 * std::numbers::pi / width, yaw = heading - (column + 0.5 - width / 2.0) * pixel, down = 0.5 * pixel;
      const double dx = -std::sin(yaw) * std::cos(down), dy = -std::sin(down), dz = -std::cos(yaw) * std::cos(down);
      const double to_x = dx > 0 ? (6 - x) / dx : -x / dx, to_z = dz > 0 ? (4 - z) / dz : -z / dz, to_floor = -y / dy;
      const double expected_mm = 1000 * std::min({to_x, to_z, to_floor});
      EXPECT_NEAR(depth[static_cast<std::size_t>(24 * width + column)], expected_mm, 1.5) << column;  // to a millimetre, rounded
    }
    EXPECT_LE(lines[i]["distance_m"].get<double>(), 5);
    EXPECT_EQ(read_file(folder_.path() / "pano" / lines[i]["rgb_file"].get<std::string>()).substr(1, 3), "PNG");
  }
  const auto corpus = parse_json(read_file(folder_.path() / "pano/corpus.json"));
  EXPECT_EQ(corpus["categories"][0], "unknown");
  expect_refused("pano shoebox:6x3x4@0.3 --size 100 --out " + path("refused"), "--size 100");
  expect_refused("pano shoebox:6x3x4@0.3 --size 4294967424x48 --out " + path("refused"), "is not a size");
  expect_refused("pano shoebox:6x3x4@0.3 --size 100x80 --out " + path("refused"), "at most half as high");
}

}  // namespace
}  // namespace earshot
