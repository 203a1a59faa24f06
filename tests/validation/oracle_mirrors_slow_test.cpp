// SPDX-License-Identifier: Apache-2.0
#include <gtest/gtest.h>

#include <cstdio>

#include "sim/acoustics/response/energy_response.h"
#include "tests/support/acoustics/decay.h"
#include "tests/support/acoustics/image_sum.h"
#include "tests/support/acoustics/shoe2.h"

// docs/evidence/oracles.md, O-4: decay in rooms of mirrors, by all images.
namespace earshot {
namespace {

TEST(OracleO4, ImageSumOfTheTestHasTheTable) {
  const radiosity::Point source{1.2, 1.5, 1.1}, listener{3.8, 2.3, 1.6};
  struct Case {
    double absorption, length_s, t20_s, t30_s, indirect;
  };
  for (const Case& c :
       {Case{0.1, 1.6, 1.0966, 1.1432, 0.028876}, {0.2, 0.8, 0.51987, 0.54154, 0.011951}, {0.5, 0.4, 0.17207, 0.17767, 0.0024413}}) {
    const double bin_s = 1e-4;
    const auto series = image_sum::energy_series({5, 4, 3}, c.absorption, source, listener, bin_s, c.length_s);
    const auto heard = std::span(series).subspan(static_cast<std::size_t>(2.765863 / 343 / bin_s));
    EXPECT_NEAR(decay::time_s(heard, bin_s, -5, -25), c.t20_s, 0.005 * c.t20_s) << c.absorption;
    EXPECT_NEAR(decay::time_s(heard, bin_s, -5, -35), c.t30_s, 0.005 * c.t30_s) << c.absorption;
    EXPECT_NEAR(decay::curve(series)[0] - decay::direct_energy(2.765863), c.indirect, 1e-3 * c.indirect) << c.absorption;
  }
}

TEST(OracleO4, MirrorsOfSixMaterialsPerOctave) {
  // 125 Hz to 4 kHz; decay times differ by a factor of four in one run.  EDC levels are relative to the start, direct sound included.
  const double t20_s[] = {0.65221, 1.2556, 2.0895, 2.658, 2.3436, 2.2592},
               drr_db[] = {-10.389, -10.743, -10.906, -10.405, -10.076, -10.545};
  const double at_100_ms_db[] = {-11.733, -8.0797, -6.3534, -5.7723, -6.1451, -6.3268};
  const double at_500_ms_db[] = {-41.041, -26.716, -19.109, -16.489, -17.848, -18.556};
  constexpr double bin_s = 1e-3, length_s = 2.4;
  AcousticConfig config = rooms::plain_config();
  config.early = Switch::automatic;
  config.early_order = 4;
  config.bands = 0;
  config.rays = 16384;
  config.source_radius_m = 1.0f;
  config.rir_length_s = static_cast<float>(length_s);
  config.time_bin_s = static_cast<float>(bin_s);
  const auto room = shoe2::room(0);
  std::vector<double> traced_t20[shoe2::kBands], traced_drr[shoe2::kBands], level_100[shoe2::kBands], level_500[shoe2::kBands];
  for (int seed = 1; seed <= 16; ++seed) {
    config.seed = static_cast<std::uint64_t>(seed);
    const AcousticScene scene(room, config);
    EnergyResponse response;
    compute_energy_response(scene, EarlyCandidates(scene, shoe2::source()), shoe2::listener(), response);
    const double direct_s = response.arrivals[0].distance_m / 343.0;
    for (int band = 0; band < shoe2::kBands; ++band) {
      std::vector<double> heard(static_cast<std::size_t>((length_s - direct_s) / bin_s), 0.0);
      const auto add = [&](double time_s, double energy) {
        const double bin = (time_s - direct_s) / bin_s + 1e-6;
        if (bin >= 0 && bin < static_cast<double>(heard.size())) heard[static_cast<std::size_t>(bin)] += energy;
      };
      for (const Arrival& arrival : response.arrivals) {
        add(arrival.distance_m / 343.0, double{arrival.amplitude[band]} * arrival.amplitude[band]);
      }
      // A bin of the histogram straddles two bins that count from the direct sound.
      const std::vector<double> late = response.late.band_energy(band);
      const double later = direct_s / bin_s - std::floor(direct_s / bin_s);
      for (std::size_t i = 0; i < late.size(); ++i) {
        add((static_cast<double>(i) + 0.5 * later) * bin_s, later * late[i]);
        add((static_cast<double>(i) + 0.5 * (1 + later)) * bin_s, (1 - later) * late[i]);
      }
      const std::vector<double> left = decay::curve(heard);
      const double direct = std::pow(double{response.arrivals[0].amplitude[band]}, 2);
      traced_t20[band].push_back(decay::time_s(heard, bin_s, -5, -25));
      traced_drr[band].push_back(10 * std::log10(direct / (left[0] - direct)));
      level_100[band].push_back(decay::level_db(left, bin_s, 0.1));
      level_500[band].push_back(decay::level_db(left, bin_s, 0.5));
    }
  }
  for (int band = 0; band < shoe2::kBands; ++band) {
    // `model`: the late field is a mean over the source volume, the record ends at 2.4 s (-50 dB in the slowest octave).
    const auto compare = [&](const char* metric, std::span<const double> values, double exact, double model, double largest_sigma) {
      const decay::Estimate traced = decay::estimate(values);
      std::printf("SHOE-2 mirrors, band %d %-10s images %.5g, traced %.5g +- %.2g (%.2f sigma)\n", band, metric, exact, traced.mean,
                  traced.standard_error, (traced.mean - exact) / traced.standard_error);
      EXPECT_NEAR(traced.mean, exact, 3.5 * traced.standard_error + model) << metric << " in band " << band;
      EXPECT_LT(traced.standard_error, largest_sigma) << metric << " in band " << band;
    };
    compare("DRR", traced_drr[band], drr_db[band], 0.05, 0.1);
    compare("T20", traced_t20[band], t20_s[band], 0.005 * t20_s[band], 0.03 * t20_s[band]);
    compare("EDC 100 ms", level_100[band], at_100_ms_db[band], 0.02, 0.1);
    compare("EDC 500 ms", level_500[band], at_500_ms_db[band], 0.05, 0.3);
  }
}

}  // namespace
}  // namespace earshot
