// SPDX-License-Identifier: Apache-2.0
#include <gtest/gtest.h>

#include <array>
#include <cmath>
#include <limits>
#include <vector>

#include "sim/acoustics/metrics/late_errors.h"
#include "sim/acoustics/metrics/room_metrics.h"
#include "sim/acoustics/response/energy_response.h"
#include "sim/acoustics/tracers/bidirectional_tracer.h"
#include "sim/audio/head/directivity.h"
#include "tests/support/acoustics/bidirectional_field.h"
#include "tests/support/acoustics/late_field.h"
#include "tests/support/acoustics/rooms.h"

namespace earshot {
namespace {

using rooms::bidirectional_config;
using rooms::bidirectional_field;
using rooms::BidirectionalField;
using rooms::expect_near;
using rooms::expect_same;
using rooms::Sample;

TEST(BidirectionalSlow, O10_EnergiesAndLaplaceSumsOfLambertBoxes) {
  struct Case {
    const char* name;
    double wall_absorption, floor_absorption, rir_length_s;
    double sum[5];  // sigma = 0, 5, 10, 20, 40 per second
  };
  const Case cases[] = {{"a=.1", .1, .1, 1.2, {0.028595, 0.019698, 0.014598, 0.0090462, 0.0044042}},
                        {"a=.2", .2, .2, 0.6, {0.012029, 0.0096258, 0.0078759, 0.0055258, 0.0030544}},
                        {"a=.5", .5, .5, 0.25, {0.0026387, 0.0023472, 0.0020943, 0.0016808, 0.0011107}},
                        {"floor.6", .05, .6, 0.7, {0.013665, 0.010735, 0.0086638, 0.0059629, 0.0032202}}};
  const double sigmas_per_s[] = {0, 5, 10, 20, 40};
  AcousticConfig config = bidirectional_config(8192);
  config.time_bin_s = 0.001f;
  for (const Case& c : cases) {
    std::array<Material, 6> walls = rooms::uniform_walls(c.wall_absorption, 1);
    walls[4] = Material::uniform("floor", static_cast<float>(c.floor_absorption), 1.f);
    config.rir_length_s = static_cast<float>(c.rir_length_s);  // to -70 dB
    const BidirectionalField field =
        bidirectional_field(rooms::box(5, 4, 3, walls), config, rooms::shoe1_source(), rooms::shoe1_listener());
    for (int i = 0; i < 5; ++i) {
      expect_near(field.sum(0, [&](double t) { return std::exp(-sigmas_per_s[i] * t); }), c.sum[i], 4, 5e-3, c.name);
    }
  }
}

TEST(BidirectionalSlow, O10_TurningStrategiesOffKeepsTheMean) {
  // Up to three bounces, so that light tracing alone can make every path.
  AcousticConfig config = bidirectional_config(16384);
  config.max_bounces = 3;
  config.source_bounces = 3;
  config.rir_length_s = 0.25f;
  const auto total = [&](double scattering, bool next_event, bool connection, bool to_listener) {
    return bidirectional_field(rooms::shoe1(0.2, scattering), config, rooms::shoe1_source(), rooms::shoe1_listener(),
                               {.next_event = next_event, .connection = connection, .to_listener = to_listener})
        .total();
  };
  const Sample all = total(1, true, true, true);
  const Sample next_event = total(1, true, false, false), to_listener = total(1, false, false, true);
  expect_same(all, next_event, 4, 8e-3, "next event");
  expect_same(all, to_listener, 4, 8e-3, "to the listener");
  expect_same(all, total(1, true, true, false), 4, 8e-3, "without light tracing");
  expect_same(all, total(1, true, false, true), 4, 8e-3, "without inner connections");
  expect_same(all, total(1, false, true, true), 4, 8e-3, "without next event");
  // Balance heuristic: never much worse than the best strategy alone.  Ratio of two variances of 15 degrees of freedom each, which
  // their own scatter can double: the margin is large because the gain is (measured 0.2).
  const double best = std::min(next_event.standard_error, to_listener.standard_error);
  EXPECT_LT(all.standard_error * all.standard_error, 1.1 * best * best);
}

TEST(BidirectionalSlow, O18_NothingIsLostOrGainedInALosslessRoom) {
  // c / (4 pi V) = 0.454921 per second, flat; lobes, mirrors and Lambert alike.  Forty bounces: one per cent lost in each would be a third.
  AcousticConfig config = bidirectional_config(4096);
  config.rir_length_s = 0.4f;
  config.source_radius_m = 0.6f;
  struct Case {
    float exponent;
    double scattering;
    double fraction;
  };
  for (const Case& c : {Case{0, 1, 0.01}, Case{0, 0.4, 0.05}, Case{1, 0, 0.05}, Case{10, 0.3, 0.05}, Case{100, 0.1, 0.05}}) {
    config.specular_exponent = c.exponent;
    const BidirectionalField field =
        bidirectional_field(rooms::shoe1(0, c.scattering), config, rooms::shoe1_source(), rooms::shoe1_listener());
    for (const double from : {0.1, 0.2, 0.3}) {
      expect_near(field.sum(0, [&](double t) { return t >= from && t < from + 0.1 ? 10.0 : 0.0; }), 0.454921, 4, c.fraction);
    }
    EXPECT_EQ(field.stats.ray_escapes, 0u);
  }
}

TEST(BidirectionalSlow, O17_SourceAndListenerSwapInEveryBandAndWindow) {
  Material uneven = Material::uniform("uneven", 0.2f, 0.3f);
  uneven.absorption = {{125.f, 4000.f}, {0.1f, 0.5f}};
  uneven.scattering = {{125.f, 4000.f}, {0.3f, 0.9f}};
  std::array<Material, 6> walls = rooms::uniform_walls(0.15, 0.5);
  walls[0] = walls[4] = uneven;
  const auto room = rooms::box(5, 4, 3, walls);
  for (const float exponent : {0.f, 8.f}) {
    AcousticConfig config = bidirectional_config(8192);
    config.bands = 0;
    config.rir_length_s = 0.2f;
    config.specular_exponent = exponent;
    const glm::vec3 a = rooms::shoe1_source(), b = rooms::shoe1_listener();
    const BidirectionalField there = bidirectional_field(room, config, a, b);
    config.seed = 1;
    const BidirectionalField back = bidirectional_field(room, config, b, a);
    double squares = 0;
    int count = 0;
    for (int band = 0; band < there.histogram.num_bands(); ++band) {
      for (int window = 0; window < 10; ++window) {
        const auto in_window = [&](double t) { return t >= 0.02 * window && t < 0.02 * (window + 1) ? 1.0 : 0.0; };
        const Sample x = there.sum(band, in_window), y = back.sum(band, in_window);
        if (x.mean + y.mean == 0) continue;  // before the first arrival
        const double error = std::hypot(x.standard_error, y.standard_error);
        EXPECT_LT(std::fabs(x.mean - y.mean), 4.5 * error) << "exponent " << exponent << ", band " << band << ", window " << window;
        squares += (x.mean - y.mean) * (x.mean - y.mean) / (error * error);
        ++count;
      }
    }
    // 4.5 sigma with 15 degrees of freedom each, 70 cells; their mean square is near 1 if nothing is wrong in all of them together.
    EXPECT_LT(squares / count, 2.0) << exponent;
  }
}

TEST(BidirectionalSlow, O29_ADirectionalSourceFillsTheRoomByItsMean) {
  const auto room = rooms::shoe1(0.05, 1);
  AcousticConfig config = bidirectional_config(4096);
  config.rir_length_s = 0.8f;
  const auto late = [](double t) { return t > 0.05 ? 1.0 : 0.0; };  // a few bounces mix the directions
  SoundSource source = rooms::shoe1_source();
  const Sample omni = bidirectional_field(room, config, source, rooms::shoe1_listener()).sum(0, late);
  struct Case {
    float omni_fraction;
    double mean;
  };
  for (const Case& c : {Case{0.5f, 1.0 / 3}, Case{0.7f, 0.52}, Case{0.f, 1.0 / 3}}) {
    source.directivity = Directivity::first_order(c.omni_fraction);
    const Sample directional = bidirectional_field(room, config, source, rooms::shoe1_listener()).sum(0, late);
    // 1.5 %: the absorbed fraction of the first bounces still knows the direction of emission.
    EXPECT_NEAR(directional.mean / omni.mean, c.mean, 0.015 * c.mean + 4 * directional.standard_error / omni.mean) << c.omni_fraction;
    EXPECT_LT(directional.standard_error, 0.01 * directional.mean);

    AcousticConfig listener_rooted = config;
    listener_rooted.source_rays = 0;
    const AcousticScene scene(room, listener_rooted);
    EnergyHistogram histogram = make_histogram(scene);
    trace_late(scene, EarlyCandidates(scene, source), rooms::shoe1_listener(), histogram);
    double rooted = 0;
    for (int i = 0; i < histogram.num_bins(); ++i) rooted += histogram.energy(i, 0) * late((i + 0.5) * histogram.bin_s());
    EXPECT_NEAR(rooted / omni.mean, c.mean, 0.03 * c.mean) << c.omni_fraction;
  }
}

TEST(BidirectionalSlow, EarlyOnAndOffHoldTheSameEnergy) {
  // docs/explanation/estimators.md, section 7, with both tracers' ways of meeting the source: image paths take exactly what is left out.
  const auto room = rooms::shoe1(0.2, 0.3);
  AcousticConfig config = bidirectional_config(32768);
  const auto energy = [&](Switch early) {
    AcousticConfig c = config;
    c.early = early;
    c.early_order = 2;
    const AcousticScene scene(room, c);
    const EarlyCandidates candidates(scene, rooms::shoe1_source());
    const BidirectionalField field = bidirectional_field(room, c, rooms::shoe1_source(), rooms::shoe1_listener());
    Sample sum = field.total();
    std::vector<Arrival> arrivals;
    candidates.find_arrivals(scene, rooms::shoe1_listener(), arrivals);
    for (const Arrival& arrival : arrivals) sum.mean += double{arrival.amplitude[0]} * arrival.amplitude[0];
    return sum;
  };
  expect_same(energy(Switch::on), energy(Switch::off), 3, 0.02);
}

TEST(BidirectionalSlow, SharedRaysAreUnbiasedInEveryBand) {
  Material material = Material::uniform("m", 0.15f, 0.f);
  material.scattering = {{88.f, 353.55f, 1414.2f, 5657.f}, {0.05f, 0.2f, 0.5f, 0.9f}};
  std::array<Material, 6> walls;
  walls.fill(material);
  const auto room = rooms::box(5, 4, 3, walls);
  for (const float exponent : {0.f, 20.f}) {
    AcousticConfig config = bidirectional_config(8192);
    config.bands = 4;
    config.rir_length_s = 0.2f;
    config.specular_exponent = exponent;
    config.source_radius_m = 0.5f;
    const BidirectionalField shared = bidirectional_field(room, config, rooms::shoe1_source(), rooms::shoe1_listener());
    for (const int band : {0, 3}) {
      AcousticConfig seeded_config = config;
      seeded_config.scattering = AcousticScene(room, config).scattering(0)[band];
      seeded_config.seed = 1;
      expect_same(shared.total(band), bidirectional_field(room, seeded_config, rooms::shoe1_source(), rooms::shoe1_listener()).total(band),
                  4, 0.05);
    }
  }
}

TEST(BidirectionalSlow, StandardErrorsAreThoseOverSeeds) {
  // What a response states about itself against the spread over independent seeds.
  const auto room = rooms::shoe1(0.2, 1);
  AcousticConfig config = bidirectional_config(512);
  config.rir_length_s = 0.4f;
  double energy_sum = 0, energy_squares = 0, t20_sum = 0, t20_squares = 0, stated_energy = 0, stated_t20 = 0;
  constexpr int seeds = 40;
  for (int seed = 0; seed < seeds; ++seed) {
    config.seed = static_cast<std::uint64_t>(seed);
    const AcousticScene scene(room, config);
    EnergyResponse response;
    compute_energy_response(scene, EarlyCandidates(scene, rooms::shoe1_source()), rooms::shoe1_listener(), response);
    const std::vector<BandErrors> errors = late_errors(scene, response);
    ASSERT_EQ(errors.size(), 1u);
    ASSERT_TRUE(errors[0].t20_error_s && errors[0].t30_error_s);
    const double t20_s = measure(scene, response).bands[0].t20_s.value();
    energy_sum += errors[0].late_energy, energy_squares += errors[0].late_energy * errors[0].late_energy;
    t20_sum += t20_s, t20_squares += t20_s * t20_s;
    stated_energy += errors[0].late_energy_error * errors[0].late_energy_error / seeds;
    stated_t20 += *errors[0].t20_error_s * *errors[0].t20_error_s / seeds;
  }
  const auto variance = [](double sum, double squares) { return (squares - sum * sum / seeds) / (seeds - 1); };
  // A variance from 40 seeds scatters by 23 %, 3 sigma; a wrong factor 16 or sqrt(16) would be far outside.
  EXPECT_NEAR(std::sqrt(stated_energy / variance(energy_sum, energy_squares)), 1.0, 0.4);
  EXPECT_NEAR(std::sqrt(stated_t20 / variance(t20_sum, t20_squares)), 1.0, 0.4);
  // And the decay time itself is that of O-10, direct sound included: 0.4814 s.
  EXPECT_NEAR(t20_sum / seeds, 0.4814, 0.01 * 0.4814);
}

}  // namespace
}  // namespace earshot
