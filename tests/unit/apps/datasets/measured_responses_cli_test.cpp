// SPDX-License-Identifier: Apache-2.0
// `earshot dataset convolve --measured`: speech through measured responses.

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <array>
#include <cmath>
#include <numbers>
#include <string>
#include <vector>

#include "tests/support/programs/dataset_cli.h"

namespace earshot {
namespace {

class MeasuredResponsesCli : public DatasetCli {
 protected:
  MeasuredResponsesCli() : DatasetCli("measured_responses_cli") {
    speak("a.wav", 1, 900);
    speak("b.wav", 2, 700);
  }
  /// Delays of the direct sound, its level, and a decay of noise.
  std::vector<float> record(std::uint64_t seed, std::size_t delay, float direct, int channels = 1) const {
    std::vector<float> samples;
    for (int c = 0; c < channels; ++c) {
      std::vector<float> one = noise_of(seed + 100 * static_cast<std::uint64_t>(c), 4000);
      for (std::size_t n = 0; n < one.size(); ++n)
        one[n] *=
            n < delay + 40 ? 0.f : direct * 0.3f * static_cast<float>(std::exp(-3 * std::numbers::ln10 * static_cast<double>(n) / 2400));
      one[delay] = direct;
      samples.insert(samples.end(), one.begin(), one.end());
    }
    return samples;
  }
  void write_record(const std::string& name, std::uint64_t seed, std::size_t delay, float direct, int channels = 1,
                    int rate = kRateHz) const {
    std::filesystem::create_directories(std::filesystem::path(path(name)).parent_path());
    write_wav(path(name), record(seed, delay, direct, channels), channels, static_cast<float>(rate));
  }
  [[nodiscard]] Outcome signals(const std::string& folder, const std::string& out, const std::string& more = "") const {
    return dataset("convolve " + path(folder) + " --measured --speech " + path("speech") + " --count 12 --out " + path(out) + " " + more);
  }
};

// Each signal is the speech through the record, brought to a direct sound of 1 / (4 pi r).
TEST_F(MeasuredResponsesCli, SignalsAreSpeechThroughTheRecords) {
  write_record("room/one/a.wav", 11, 80, 0.5f);
  write_record("room/one/b.wav", 12, 133, 0.02f);
  write_record("room/two/c.wav", 13, 240, 0.9f);
  const Outcome made = signals("room", "out", "--format wav");
  ASSERT_EQ(made.exit_code, 0) << made.text;
  int seen = 0;
  for (const auto& line : lines("out/manifest.jsonl")) {
    const auto& talker = line.at("talkers").at(0);
    const std::string id = talker.at("response");
    const bool is_a = id == "one/a", is_b = id == "one/b";
    EXPECT_TRUE(is_a || is_b || id == "two/c") << id;
    EXPECT_EQ(talker.at("room"), is_a || is_b ? 0 : 1);
    EXPECT_NEAR(talker.at("direct_delay_s").get<double>(), (is_a ? 80 : is_b ? 133 : 240) / 8000.0, 1e-6);
    EXPECT_TRUE(talker.at("scene").is_null());
    const std::vector<float> dry = load_sound(path("speech/" + talker.at("speech").get<std::string>()), kRateHz).samples;
    const std::vector<float> response = is_a ? record(11, 80, 0.5f) : is_b ? record(12, 133, 0.02f) : record(13, 240, 0.9f);
    const float direct = is_a ? 0.5f : is_b ? 0.02f : 0.9f;
    const std::vector<float> wet = load_sound(path("out/" + line.at("file").get<std::string>()), kRateHz).samples;
    std::vector<double> expected(wet.size(), 0.0);
    for (std::size_t i = 0; i < dry.size(); ++i)
      for (std::size_t k = 0; k < response.size() && i + k < expected.size(); ++k)
        expected[i + k] += double{dry[i]} * double{response[k]} / double{direct} / (4 * std::numbers::pi);
    // The level of a signal is drawn: one factor for all samples, that of the manifest.
    double product = 0, own = 0, error = 0, energy = 0;
    for (std::size_t i = 0; i < wet.size(); ++i) product += expected[i] * double{wet[i]}, own += expected[i] * expected[i];
    const double factor = product / own;
    for (std::size_t i = 0; i < wet.size(); ++i) {
      error += std::pow(double{wet[i]} - factor * expected[i], 2);
      energy += std::pow(double{wet[i]}, 2);
    }
    EXPECT_LT(error, 1e-8 * energy) << id;
    EXPECT_NEAR(factor / talker.at("gain").get<double>(), 1, 1e-4) << id;
    ++seen;
  }
  EXPECT_EQ(seen, 12);
}

// With places, sources that share a microphone speak together, at their distances.
TEST_F(MeasuredResponsesCli, PlacesGiveTalkersOfOneRoom) {
  std::string places = "responses:\n";
  for (int source = 0; source < 3; ++source)
    for (int listener = 0; listener < 2; ++listener) {
      const std::string name = "s" + std::to_string(source) + "l" + std::to_string(listener) + ".wav";
      write_record("room/" + name, 20 + static_cast<std::uint64_t>(2 * source + listener), 100 + static_cast<std::size_t>(20 * source),
                   0.3f);
      places += "  - {file: " + name + ", source: [" + std::to_string(1 + source) + ", 1, 1], listener: [1, 1, " +
                std::to_string(3 + listener) + "]}\n";
    }
  write_text(path("room/places.yaml"), places);
  const Outcome made = signals("room", "out", "--talkers 2,3");
  ASSERT_EQ(made.exit_code, 0) << made.text;
  for (const auto& line : lines("out/manifest.jsonl")) {
    std::set<int> sources;
    for (const auto& talker : line.at("talkers")) {
      sources.insert(talker.at("source").get<int>());
      EXPECT_EQ(talker.at("response").get<std::string>().back(), line.at("talkers").at(0).at("response").get<std::string>().back());
      const int source = talker.at("source"), listener = talker.at("response").get<std::string>().back() - '0';
      EXPECT_NEAR(talker.at("distance_m").get<double>(), std::hypot(source, 2 + listener), 1e-6);
    }
    EXPECT_EQ(sources.size(), line.at("talkers").size());
  }
}

TEST_F(MeasuredResponsesCli, RefusesWhatIsNotMeasured) {
  write_record("room/a.wav", 1, 80, 0.5f);
  expect_refused(signals("corpus", "refused"), "leave out --measured", "refused");
  expect_refused(signals("nowhere", "refused"), "nowhere", "refused");
  std::filesystem::create_directories(path("empty"));
  expect_refused(signals("empty", "refused"), "empty", "refused");
  write_record("stereo/a.wav", 1, 80, 0.5f);
  write_record("stereo/b.wav", 1, 80, 0.5f, 2);
  expect_refused(signals("stereo", "refused"), "has 2 channels at 8000 Hz, files before it have 1", "refused");
  write_record("rates/a.wav", 1, 80, 0.5f);
  write_record("rates/b.wav", 1, 80, 0.5f, 1, 16000);
  expect_refused(signals("rates", "refused"), "at 16000 Hz", "refused");
  std::filesystem::create_directories(path("silent"));
  write_wav(path("silent/a.wav"), std::vector<float>(100, 0.f), 1, kRateHz);
  expect_refused(signals("silent", "refused"), "is silent", "refused");
  expect_refused(signals("room", "room/refused"), "CORPUS", "room/refused");
  expect_refused(signals("room", "refused", "--talkers 2"), "fewer talkers", "refused");
  expect_refused(signals("room", "refused", "--early"), "early", "refused");
  write_text(path("room/places.yaml"), "responses:\n  - {file: b.wav, source: [1, 1, 1], listener: [2, 1, 1]}\n");
  expect_refused(signals("room", "refused"), "b.wav", "refused");
  // Speech in the place of responses is no corpus.
  expect_refused(dataset("convolve " + path("speech") + " --speech " + path("speech") + " --out " + path("refused")), "--measured",
                 "refused");
}

}  // namespace
}  // namespace earshot
