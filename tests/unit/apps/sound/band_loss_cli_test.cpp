// SPDX-License-Identifier: Apache-2.0
// What air leaves of a sound, heard through `earshot rir`, and the bands that the program reports.

#include <fmt/format.h>
#include <gtest/gtest.h>

#include <cmath>
#include <complex>
#include <nlohmann/json.hpp>
#include <numbers>
#include <vector>

#include "sim/acoustics/model/air_absorption.h"
#include "sim/audio/transforms/fft.h"
#include "sim/base/random.h"
#include "sim/base/text/json.h"
#include "tests/support/programs/cli.h"

namespace earshot {
namespace {

class BandLossCli : public Cli {
 protected:
  /// Spectrum of the direct sound over `distance_m`, of a size that fits, times 4 pi distance: that of the air.
  [[nodiscard]] std::vector<std::complex<float>> direct_sound(const Air& air, double rate_hz, double distance_m) const {
    write("air.yaml", fmt::format("mesh: shoebox:400x20x20@1\nair: {{temperature_c: {}, humidity_percent: {}}}\n", air.temperature_c,
                                  air.humidity_percent));
    const CliOutcome outcome = earshot(
        fmt::format("rir {} --source 20,10,10 --listener {},10,10 --channels mono --set air_absorption=on rir_length_s=1 sample_rate_hz={} "
                    "--out {}",
                    file("air.yaml"), 20 + distance_m, rate_hz, file("r.wav")));
    EXPECT_EQ(outcome.exit_code, 0) << outcome.errors;
    std::vector<float> samples = read_wav("r.wav");
    for (float& sample : samples) sample *= static_cast<float>(4 * std::numbers::pi * distance_m);
    RealFft fft(next_power_of_two(static_cast<int>(samples.size())));
    std::vector<std::complex<float>> spectrum(static_cast<std::size_t>(fft.num_bins()));
    fft.forward(samples, spectrum);
    return spectrum;
  }
  /// Level of the band in dB over that of a flat spectrum.
  static double band_db(const std::vector<std::complex<float>>& spectrum, double rate_hz, double low_hz, double high_hz) {
    const double bin_hz = rate_hz / static_cast<double>(2 * (spectrum.size() - 1));
    double sum = 0, count = 0;
    for (std::size_t k = 0; k < spectrum.size(); ++k) {
      const double frequency_hz = static_cast<double>(k) * bin_hz;
      if (frequency_hz < low_hz || frequency_hz > high_hz) continue;
      sum += static_cast<double>(std::norm(spectrum[k]));
      count += 1;
    }
    return 10 * std::log10(sum / count);
  }
};

// The integral of 10^(-a(f) d / 10) over the band at 20 degrees and 50 % gives -4.60 dB below 7,943 Hz and -18.46 dB.
TEST_F(BandLossCli, HighBandsLoseWhatTheAirTakes) {
  const Air usual;
  EXPECT_NEAR(band_db(direct_sound(usual, 16000, 60), 16000, 5623, 7943), -4.60, 0.1);
  EXPECT_NEAR(band_db(direct_sound(usual, 48000, 60), 48000, 11500, 20000), -18.46, 0.1);
}

// 0.5 dB: an eighth of what a step between octaves at 60 m was; doubled attenuation would be seen from 0.5 dB of it on.
TEST_F(BandLossCli, DirectSoundFollowsIso9613AtEveryFrequency) {
  constexpr double rates_hz[] = {8000, 16000, 22050, 44100, 48000};
  for (std::uint32_t draw = 0; draw < 10; ++draw) {
    const RandomStream random(38, Purpose::test, 23, draw);
    const Air air{.temperature_c = static_cast<float>(std::round(-20 + 70 * double{random.uniform(0)})),
                  .humidity_percent = static_cast<float>(std::round(100 * double{random.uniform(1)}))};
    const double rate_hz = rates_hz[draw % 5], distance_m = std::round(5 + 195 * double{random.uniform(2)});
    const std::vector<std::complex<float>> spectrum = direct_sound(air, rate_hz, distance_m);
    const double bin_hz = rate_hz / static_cast<double>(2 * (spectrum.size() - 1));
    for (std::size_t k = 0; static_cast<double>(k) * bin_hz < 0.45 * rate_hz; ++k) {
      const double frequency_hz = static_cast<double>(k) * bin_hz, loss_db = distance_m * air_absorption_db_per_m(air, frequency_hz);
      if (frequency_hz < 100 || loss_db > 60) continue;
      ASSERT_NEAR(20 * std::log10(std::abs(std::complex<double>(spectrum[k]))), -loss_db, 0.5)
          << frequency_hz << " Hz, " << distance_m << " m, " << air.temperature_c << " C, " << air.humidity_percent << " %, rate "
          << rate_hz;
    }
  }
}

TEST_F(BandLossCli, BandsReachFrom63HzTo16kHz) {
  const auto bands_of = [&](const std::string& settings) {
    const CliOutcome outcome = earshot("rir shoebox:5x4x3@0.3 --source 1,1.5,1 --listener 4,1.5,2 --channels mono --set rays=16 " +
                                       settings + " --out " + file("b.wav") + " --metrics " + file("b.json"));
    EXPECT_EQ(outcome.exit_code, 0) << outcome.errors;
    const nlohmann::json json = parse_json(read("b.json"));
    for (const char* part : {"energy", "rir"}) EXPECT_EQ(json.at(part).at("t20_s").size(), json.at("bands_hz").size()) << settings;
    return json.at("bands_hz").get<std::vector<double>>();
  };
  const std::vector<double> usual = bands_of("sample_rate_hz=16000"), high = bands_of("sample_rate_hz=48000"),
                            all = bands_of("sample_rate_hz=48000 low_octave=true"), low = bands_of("low_octave=true");
  EXPECT_EQ(usual.size(), 7u);
  EXPECT_EQ(low.size(), 8u);
  EXPECT_EQ(high.size(), 8u);
  ASSERT_EQ(all.size(), 9u);
  EXPECT_NEAR(all.front(), 63.1, 0.1);
  EXPECT_NEAR(all.back(), 15849, 1);
  EXPECT_NEAR(usual.back(), 6707, 1);
  expect_bad_input("rir shoebox:5x4x3@0.3 --source 1,1.5,1 --listener 4,1.5,2 --set bands=4 low_octave=true --out " + file("x.wav"),
                   "low_octave");
}

}  // namespace
}  // namespace earshot
