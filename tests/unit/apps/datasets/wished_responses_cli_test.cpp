// SPDX-License-Identifier: Apache-2.0
// Reverberation times and direct-to-reverberant ratios of a corpus of signals, drawn as a user asks.

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <array>
#include <cmath>
#include <string>
#include <vector>

#include "tests/support/programs/dataset_cli.h"

namespace earshot {
namespace {

class WishedResponsesCli : public DatasetCli {
 protected:
  WishedResponsesCli() : DatasetCli("wished_responses_cli") {
    write_text(
        path("many.yaml"),
        "seed: 3\nshoeboxes: {count: 60, max_size_m: [8, 4, 8], absorption: [0.1, 0.6]}\nsources_per_room: 2\nlisteners_per_source: 8\n"
        "channels: mono\nacoustics: {rays: 64, rir_length_s: 0.6, sample_rate_hz: 8000}\n");
    EXPECT_EQ(dataset("rir " + path("many.yaml") + " --out " + path("many")).exit_code, 0);
    speak("a.wav", 1, 16);
    speak("b.wav", 2, 16);
  }
  [[nodiscard]] Outcome signals(const std::string& out, const std::string& more) const {
    return dataset("convolve " + path("many") + " --speech " + path("speech") +
                   " --cut --count 2000 --signals-per-folder 2000 --threads 2 --out " + path(out) + " " + more);
  }
  /// Counts of the tenths of a range, and what lies outside.
  [[nodiscard]] std::array<int, 11> counts(const std::string& out, const std::string& key, double low, double high) const {
    std::array<int, 11> found{};
    for (const auto& line : lines(out + "/manifest.jsonl")) {
      const auto& value = line["talkers"][0][key];
      const double position = value.is_null() ? -1 : 10 * (value.get<double>() - low) / (high - low);
      ++found[position < 0 || position > 10 ? 10 : std::min<std::size_t>(9, static_cast<std::size_t>(position))];
    }
    return found;
  }
  /// 2000 signals: 200 in each tenth, with a standard deviation of sqrt(2000 * 0.1 * 0.9) = 13.4; 4.5 of them, and 1 % of the fit.
  static void expect_uniform(const std::array<int, 11>& found) {
    for (std::size_t part = 0; part < 10; ++part) EXPECT_NEAR(found[part], 200, 4.5 * 13.4 + 2) << part;
    EXPECT_EQ(found[10], 0);
  }
};

TEST_F(WishedResponsesCli, EachTenthOfARangeComesEquallyOften) {
  ASSERT_EQ(signals("plain", "").exit_code, 0);
  const auto plain = counts("plain", "t20_mid_s", 0.15, 0.45);
  EXPECT_GT(*std::ranges::max_element(plain), 300);  // far from uniform in the corpus itself
  Outcome made = signals("rt60", "--rt60 0.15,0.45");
  ASSERT_EQ(made.exit_code, 0) << made.text;
  expect_uniform(counts("rt60", "t20_mid_s", 0.15, 0.45));
  made = signals("drr", "--drr -10,2");
  ASSERT_EQ(made.exit_code, 0) << made.text;
  expect_uniform(counts("drr", "drr_db", -10, 2));
  made = signals("both", "--rt60 0.15,0.45 --drr -8,0");
  ASSERT_EQ(made.exit_code, 0) << made.text;
  expect_uniform(counts("both", "t20_mid_s", 0.15, 0.45));
  expect_uniform(counts("both", "drr_db", -8, 0));

  expect_refused(signals("refused", "--rt60 0.15,9"), "finds no response from", "refused");
  expect_refused(signals("refused", "--drr 3,-3"), "--drr", "refused");
  const Outcome other = signals("rt60", "--rt60 0.15,0.4");
  EXPECT_THAT(other.text, testing::HasSubstr("started with other settings: 'rt60_s: [0.15, 0.45]' there"));
}

}  // namespace
}  // namespace earshot
