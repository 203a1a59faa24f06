// SPDX-License-Identifier: Apache-2.0
// Random materials as `earshot scene` and `earshot dataset rir` show them.

#include <fmt/format.h>
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cmath>
#include <set>
#include <string>
#include <vector>

#include "sim/base/text/json.h"
#include "tests/support/programs/dataset_cli.h"

namespace earshot {
namespace {

using testing::HasSubstr;

class RandomizedRoomsCli : public DatasetCli {
 protected:
  RandomizedRoomsCli() : DatasetCli("randomized_rooms_cli") {}

  /// Reverberation times by octave of a shoebox with this absorption and further keys.
  [[nodiscard]] std::vector<double> times_of(const std::string& absorption, const std::string& keys) const {
    write_text(path("room.yaml"), "mesh: shoebox:5x4x3@" + absorption + "\n" + keys);
    const std::string command =
        earshot_program().string() + " scene " + path("room.yaml") + " --json " + path("room.json") + " >" + path("output");
    EXPECT_EQ(std::system(command.c_str()), 0);
    return parse_json(read_file(path("room.json"))).at("rt60_estimate_s").get<std::vector<double>>();
  }
};

// Eyring's time is K / (m - ln(1 - a)) for the absorption a, with K and m from two rooms of known absorption.  64 seeds of seven octaves: a
// deviation has the standard error 1 / sqrt(2 * 448) = 3.3 %, a mean 4.7 % of the deviation, a correlation 5 %; four of them.
TEST_F(RandomizedRoomsCli, OctavesVaryAsAsked) {
  const std::vector<double> low = times_of("0.3", ""), high = times_of("0.7", "");
  constexpr int kSeeds = 64;
  const auto absorption_of = [&](double time_s, std::size_t octave) {
    const double log_low = -std::log(1 - 0.3), log_high = -std::log(1 - 0.7);
    const double air = (high[octave] * log_high - low[octave] * log_low) / (low[octave] - high[octave]);
    return 1 - std::exp(-(low[octave] * (log_low + air) / time_s - air));
  };
  const double n = kSeeds * static_cast<double>(low.size());
  for (const double correlation : {0.0, 0.8}) {
    double sum = 0, squares = 0, products = 0;
    for (int seed = 0; seed < kSeeds; ++seed) {
      const std::vector<double> times = times_of(
          "0.5", fmt::format("randomize: {{seed: {}, candidates: false, noise_std: 0.1, noise_correlation: {}}}\n", seed, correlation));
      double before = 0;
      for (std::size_t octave = 0; octave < low.size(); ++octave) {
        const double apart = absorption_of(times[octave], octave) - 0.5;
        sum += apart;
        squares += apart * apart;
        if (octave > 0) products += apart * before;
        before = apart;
      }
    }
    const double deviation = std::sqrt(squares / n);
    // Correlated octaves are fewer numbers: 64 rooms alone bound the error.
    const double numbers = correlation > 0 ? 2 * kSeeds : n;
    EXPECT_NEAR(sum / n, 0, 4 * 0.1 / std::sqrt(numbers)) << correlation;
    EXPECT_NEAR(deviation / 0.1, 1, 4 / std::sqrt(2 * numbers)) << correlation;
    const double pairs = kSeeds * static_cast<double>(low.size() - 1);
    // (1 - r^2) / sqrt(pairs) for a correlation r, four of them; its neighbours share rooms, for which 0.12 is left with r = 0.8 (0.07).
    const double error = correlation > 0 ? 0.12 : std::min(4 / std::sqrt(pairs), 0.21);
    EXPECT_NEAR(products / pairs / (deviation * deviation), correlation, error) << correlation;
  }
}

TEST_F(RandomizedRoomsCli, CorporaStateAndCheckTheirRandomization) {
  const std::string rooms =
      "seed: 3\nshoeboxes: {count: 0}\nscenes: [\"house:5,rooms=1,area_m2=20\"]\nsources_per_room: 1\n"
      "listeners_per_source: 1\nchannels: mono\nacoustics: {rays: 16, rir_length_s: 0.05, sample_rate_hz: 8000}\n";
  const std::vector<std::string> settings{"{}",
                                          "{uniform: true}",
                                          "{per: object}",
                                          "{per: object, uniform: true}",
                                          "{noise_correlation: 0.5}",
                                          "{candidates: false, noise_std: 0.05}"};
  std::set<std::string> scenes;
  for (std::size_t i = 0; i < settings.size(); ++i) {
    const std::string config = path(fmt::format("rooms{}.yaml", i)), out = path(fmt::format("rooms{}", i));
    write_text(config, rooms + "randomize: " + settings[i] + "\n");
    const Outcome made = dataset("rir " + config + " --out " + out);
    ASSERT_EQ(made.exit_code, 0) << made.text;
    scenes.insert(lines(fmt::format("rooms{}/manifest.jsonl", i)).at(0)["scene_hash"]);
  }
  EXPECT_EQ(scenes.size(), settings.size());
  // Without a word the noise is that of the paper.
  EXPECT_THAT(read_file(path("rooms0/corpus.json")), HasSubstr("noise_std: 0.1"));
  const Outcome other = dataset("rir " + path("rooms1.yaml") + " --out " + path("rooms0"));
  EXPECT_EQ(other.exit_code, 2);
  EXPECT_THAT(other.text, HasSubstr("started with other settings"));
  for (const auto& [keys, message] : std::map<std::string, std::string>{
           {"{noise_correlation: 1.5}", "noise_correlation"}, {"{per: room}", "per"}, {"{unifrom: true}", "did you mean 'uniform'"}}) {
    write_text(path("wrong.yaml"), rooms + "randomize: " + keys + "\n");
    expect_refused(dataset("rir " + path("wrong.yaml") + " --out " + path("refused")), message, "refused");
  }
}

}  // namespace
}  // namespace earshot
