// SPDX-License-Identifier: Apache-2.0
// specular_exponent: from_scattering, through `earshot rir`.

#include <fmt/format.h>
#include <gtest/gtest.h>

#include <cmath>

#include "sim/base/random.h"
#include "tests/support/programs/cli.h"

namespace earshot {
namespace {

class LobeCli : public Cli {
 protected:
  [[nodiscard]] std::vector<float> response(double scattering, const std::string& exponent) const {
    const CliOutcome outcome = earshot(fmt::format(
        "rir shoebox:5x4x3 --source 1.2,1.1,1.5 --listener 3.8,1.6,2.3 --channels mono --set late=on early=off rir_length_s=0.3 rays=256 "
        "source_rays=256 scattering={} specular_exponent={} --out {}",
        scattering, exponent, file("x.wav")));
    EXPECT_EQ(outcome.exit_code, 0) << outcome.errors;
    return read_wav("x.wav");
  }
};

TEST_F(LobeCli, EndsAreTheMirrorAndLambert) {
  EXPECT_EQ(response(1, "from_scattering"), response(1, "0"));
  EXPECT_EQ(response(0, "from_scattering"), response(0, "0"));
}

// The energy after 0.1 s, by which scattering mixes directions in a room of even walls, is that of a mirror and Lambert within 1 dB.
TEST_F(LobeCli, BringsTheSameEnergy) {
  for (std::uint32_t number = 0; number < 10; ++number) {
    const double s = 0.15 + 0.85 * double{RandomStream(38, Purpose::test, number).uniform(0)};
    double energy[2] = {};
    for (int i = 0; i < 2; ++i) {
      const std::vector<float> samples = response(s, i == 0 ? "0" : "from_scattering");
      for (std::size_t n = 0; n < samples.size(); ++n) energy[i] += n > 480 ? double{samples[n]} * double{samples[n]} : 0;
    }
    EXPECT_NEAR(10 * std::log10(energy[1] / energy[0]), 0, 1) << s;
  }
}

TEST_F(LobeCli, RefusesAnExponentBelowOne) {
  expect_bad_input("rir shoebox:5x4x3 --source 1,1,1 --listener 2,1,2 --set specular_exponent=0.5 --out " + file("x.wav"),
                   "specular_exponent");
}

}  // namespace
}  // namespace earshot
