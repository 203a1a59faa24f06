// SPDX-License-Identifier: Apache-2.0
// Lateral and stage parameters (ISO 3382-1) against closed forms, in energy responses and in samples.
#include <gtest/gtest.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <glm/geometric.hpp>
#include <numbers>
#include <vector>

#include "sim/acoustics/core/bands.h"
#include "sim/acoustics/metrics/response_series.h"
#include "sim/acoustics/metrics/room_metrics.h"
#include "sim/audio/head/ambisonics.h"
#include "sim/base/errors.h"
#include "sim/base/random.h"
#include "tests/support/acoustics/rooms.h"

namespace earshot {
namespace {

constexpr double kGreenAt10m = 1 / (16 * std::numbers::pi * std::numbers::pi * 100);

double uniform_between(std::uint32_t stream, std::uint32_t draw, double low, double high) {
  return low + (high - low) * static_cast<double>(RandomStream(38, Purpose::test, 5, stream).uniform(draw));
}

glm::vec3 drawn_direction(std::uint32_t stream, std::uint32_t draw) {
  const double y = uniform_between(stream, 2 * draw, -1, 1), turn = uniform_between(stream, 2 * draw + 1, 0, 2 * std::numbers::pi);
  const double level = std::sqrt(1 - y * y);
  return {static_cast<float>(level * std::cos(turn)), static_cast<float>(y), static_cast<float>(level * std::sin(turn))};
}

AcousticConfig lateral_config(int sh_order) {
  AcousticConfig config;
  config.air_absorption = Switch::off;
  config.bands = 1;
  config.rir_length_s = 1.2f;
  config.time_bin_s = 0.001f;
  config.sh_order = sh_order;
  return config;
}

ParameterRequest lateral_request(glm::vec3 axis) {
  ParameterRequest request;
  request.lateral = true;
  request.lateral_axis = axis;
  return request;
}

void add_arrival(EnergyResponse& response, ArrivalKind kind, double time_s, double amplitude, glm::vec3 direction) {
  Arrival& arrival = response.arrivals.emplace_back();
  arrival.kind = kind;
  arrival.distance_m = static_cast<float>(time_s * 343.0);
  arrival.amplitude.fill(static_cast<float>(amplitude));
  arrival.direction = direction;
}

TEST(LateralAxis, IsLevelWithItsNullTowardTheSource) {
  for (std::uint32_t draw = 0; draw < 20; ++draw) {
    const glm::vec3 source = 5.f * drawn_direction(0, 2 * draw), listener = 2.f * drawn_direction(0, 2 * draw + 1);
    const auto axis = lateral_axis(source, listener);
    ASSERT_TRUE(axis.has_value());
    EXPECT_NEAR(glm::length(*axis), 1, 1e-6);
    EXPECT_EQ(axis->y, 0.f);
    EXPECT_NEAR(glm::dot(*axis, source - listener), 0, 1e-5);
  }
  EXPECT_FALSE(lateral_axis({1, 5, 2}, {1, 1, 2}));
}

// Means over all directions: cos^2 is 1/3, |cos| is 1/2.
TEST(LateralParameters, OfADiffuseField) {
  const AcousticScene scene(rooms::shoe1(0.2, 1), lateral_config(4));
  for (std::uint32_t draw = 0; draw < 12; ++draw) {
    const double early = uniform_between(1, 2 * draw, 0.01, 1), late = uniform_between(1, 2 * draw + 1, 1e-4, 1);
    EnergyResponse response;
    response.late = make_histogram(scene);
    std::vector<float> sh(25, 0.f);
    sh[0] = 1.f;
    response.late.add(0.0305f, std::vector<float>{static_cast<float>(early)}, sh);
    response.late.add(0.5f, std::vector<float>{static_cast<float>(late)}, sh);
    add_arrival(response, ArrivalKind::direct, 0.01, 1e-3, {0, 0, -1});
    const BandMetrics band = measure(scene, response, lateral_request(drawn_direction(1, draw))).bands[0];
    ASSERT_TRUE(band.j_lf && band.j_lfc && band.lg_db);
    EXPECT_NEAR(*band.j_lf, early / (early + 1e-6) / 3, 1e-4);
    EXPECT_NEAR(*band.j_lfc, early / (early + 1e-6) / 2, 1e-4);
    EXPECT_NEAR(*band.lg_db, 10 * std::log10(late / 3 / kGreenAt10m), 1e-3);
  }
}

// Late energy from one direction: cos^2 is exact from harmonics of order 2, |cos| is a polynomial of order 4, at most 0.12 off.
TEST(LateralParameters, OfLateEnergyFromOneDirection) {
  const AcousticScene scene(rooms::shoe1(0.2, 1), lateral_config(4)), coarse(rooms::shoe1(0.2, 1), lateral_config(2)),
      coarser(rooms::shoe1(0.2, 1), lateral_config(1));
  double worst = 0;
  for (std::uint32_t draw = 0; draw < 40; ++draw) {
    const glm::vec3 direction = drawn_direction(2, 2 * draw), axis = drawn_direction(2, 2 * draw + 1);
    const double cosine = static_cast<double>(glm::dot(direction, axis));
    for (const AcousticScene* measured : {&scene, &coarse, &coarser}) {
      EnergyResponse response;
      response.late = make_histogram(*measured);
      std::vector<float> sh(static_cast<std::size_t>(response.late.num_coefficients()));
      spherical_harmonics_n3d(direction, measured->config().sh_order, sh);
      response.late.add(0.0305f, std::vector<float>{1.f}, sh);
      response.late.add(0.3f, std::vector<float>{1.f}, sh);
      add_arrival(response, ArrivalKind::direct, 0.01, 1e-4, {0, 0, -1});
      const RoomMetrics metrics = measure(*measured, response, lateral_request(axis));
      const BandMetrics& band = metrics.bands[0];
      if (measured == &coarser) {
        EXPECT_FALSE(band.j_lf || band.j_lfc || band.lg_db);
        EXPECT_EQ(metrics.missing.size(), 3u);
        continue;
      }
      EXPECT_NEAR(*band.j_lf, cosine * cosine, 2e-5);
      if (cosine * cosine > 1e-4) {
        EXPECT_NEAR(*band.lg_db, 10 * std::log10(cosine * cosine / kGreenAt10m), 0.05);
      }
      EXPECT_EQ(band.j_lfc.has_value(), measured == &scene);
      if (band.j_lfc) worst = std::max(worst, std::abs(*band.j_lfc - std::abs(cosine)));
    }
  }
  EXPECT_LT(worst, 0.12);
}

/// Image sources of a box with uniform walls up to an order, on their own: order, distance and direction from the listener.
struct BoxImage {
  int order;
  double distance_m;
  glm::dvec3 direction;
};
std::vector<BoxImage> images_of_box(glm::dvec3 size_m, glm::dvec3 source, glm::dvec3 listener, int max_order) {
  std::vector<BoxImage> images;
  const auto at = [](int n, double length, double s) { return n * length + (n % 2 == 0 ? s : length - s); };
  for (int i = -max_order; i <= max_order; ++i)
    for (int j = -max_order; j <= max_order; ++j)
      for (int k = -max_order; k <= max_order; ++k) {
        const int order = std::abs(i) + std::abs(j) + std::abs(k);
        if (order > max_order) continue;
        const glm::dvec3 away = glm::dvec3(at(i, size_m.x, source.x), at(j, size_m.y, source.y), at(k, size_m.z, source.z)) - listener;
        images.push_back({order, glm::length(away), away / glm::length(away)});
      }
  return images;
}

// Boxes of mirrors up to the third reflection, traced by the engine, against the test's own images.  Arrivals within a bin of 1 ms of the
// limits at 5 and 80 ms may fall on either side: a draw with one there is left out.
TEST(LateralParameters, OfImagesInABox) {
  int measured = 0;
  for (std::uint32_t draw = 0; measured < 10 && draw < 60; ++draw) {
    const auto within = [&](std::uint32_t i, double low, double high) { return uniform_between(3, 20 * draw + i, low, high); };
    const glm::dvec3 size(within(0, 5, 12), within(1, 4, 9), within(2, 3, 5));
    const glm::dvec3 source = size * glm::dvec3(within(3, 0.2, 0.4), within(4, 0.2, 0.8), within(5, 0.2, 0.8));
    const glm::dvec3 listener = size * glm::dvec3(within(6, 0.6, 0.8), within(7, 0.2, 0.8), within(8, 0.2, 0.8));
    const double absorption = within(9, 0.1, 0.6);
    const glm::dvec3 toward = source - listener, across = glm::normalize(glm::dvec3(-toward.y, toward.x, 0));
    const double first_s = glm::length(toward) / 343.0;
    double all = 0, squared = 0, size_sum = 0, late = 0;
    bool is_clear = true;
    for (const BoxImage& image : images_of_box(size, source, listener, 3)) {
      const double after_s = image.distance_m / 343.0 - first_s, cosine = glm::dot(image.direction, across);
      const double energy = std::pow(1 - absorption, image.order) / std::pow(4 * std::numbers::pi * image.distance_m, 2);
      is_clear = is_clear && std::abs(after_s - 0.005) > 0.0012 && std::abs(after_s - 0.08) > 0.0012;
      if (after_s < 0.08) all += energy;
      if (after_s > 0.005 && after_s < 0.08) squared += energy * cosine * cosine, size_sum += energy * std::abs(cosine);
      if (after_s > 0.08) late += energy * cosine * cosine;
    }
    if (!is_clear) continue;
    AcousticConfig config = lateral_config(4);
    config.early_order = 3;
    config.late = config.diffraction = Switch::off;
    const AcousticScene scene(rooms::box(size.x, size.y, size.z, rooms::uniform_walls(absorption, 0)), config);
    const glm::vec3 from = rooms::point(source.x, source.y, source.z), to = rooms::point(listener.x, listener.y, listener.z);
    EnergyResponse response;
    compute_energy_response(scene, EarlyCandidates(scene, from), to, response);
    ParameterRequest request = lateral_request({});
    request.lateral_axis = lateral_axis(from, to);
    const BandMetrics band = measure(scene, response, request).bands[0];
    ASSERT_TRUE(band.j_lf && band.j_lfc);
    EXPECT_NEAR(*band.j_lf, squared / all, 1e-3) << draw;
    EXPECT_NEAR(*band.j_lfc, size_sum / all, 1e-3) << draw;
    if (late > 0) {
      EXPECT_NEAR(*band.lg_db, 10 * std::log10(late / kGreenAt10m), 0.02) << draw;
    }
    ++measured;
  }
  EXPECT_EQ(measured, 10);
}

/// Impulses at an omnidirectional and a figure-of-eight microphone.
struct TwoMicrophones {
  std::vector<float> omni = std::vector<float>(24000, 0.f), lateral = omni;
  void add(double time_s, double amplitude, double cosine) {
    const auto n = static_cast<std::size_t>(std::lround(time_s * 16000));
    omni[n] += static_cast<float>(amplitude);
    lateral[n] += static_cast<float>(amplitude * cosine);
  }
};

// Impulses 20 ms apart, so that the filters from 500 Hz up keep them apart: J_LF of energies, J_LFC of products, LG by the response at 10
// m.
TEST(LateralParameters, OfSamplesFromTwoMicrophones) {
  for (std::uint32_t draw = 0; draw < 12; ++draw) {
    const auto within = [&](std::uint32_t i, double low, double high) { return uniform_between(4, 20 * draw + i, low, high); };
    const double start_s = within(0, 0.02, 0.1), scale = within(1, 0.01, 50);
    const std::array<double, 3> after_s{within(2, 0.02, 0.03), within(3, 0.05, 0.06), within(4, 0.1, 0.5)};
    TwoMicrophones heard;
    heard.add(start_s, scale, 0);
    double all = scale * scale, squared = 0, sizes = 0, late = 0;
    for (std::uint32_t i = 0; i < 3; ++i) {
      const double amplitude = scale * within(5 + i, 0.2, 0.8), cosine = within(8 + i, -1, 1);
      heard.add(start_s + after_s[i], amplitude, cosine);
      const double energy = amplitude * amplitude;
      if (i == 2) {
        late = energy * cosine * cosine;
        continue;
      }
      all += energy, squared += energy * cosine * cosine, sizes += energy * std::abs(cosine);
    }
    std::vector<float> reference(1600, 0.f);
    const double at_10m = within(11, 0.001, 2);
    reference[300] = static_cast<float>(at_10m);
    ParameterRequest request;
    request.lateral = true;
    const auto measured = [&](RirMeasurement how) {
      how.request = request;
      return measure(heard.omni, 16000.f, how);
    };
    const RoomMetrics full = measured({.lateral = heard.lateral, .reference_10m = reference});
    for (std::size_t b = 2; b < full.bands.size(); ++b) {
      EXPECT_NEAR(full.bands[b].j_lf.value_or(-1), squared / all, 0.01) << draw << " " << b;
      EXPECT_NEAR(full.bands[b].j_lfc.value_or(-1), sizes / all, 0.02) << draw << " " << b;
      EXPECT_NEAR(full.bands[b].lg_db.value_or(-99), 10 * std::log10(late / (at_10m * at_10m)), 0.1) << draw << " " << b;
    }
    EXPECT_TRUE(full.missing.empty());
    const RoomMetrics no_reference = measured({.lateral = heard.lateral}), omni_alone = measured({});
    EXPECT_TRUE(no_reference.bands[3].j_lf && !no_reference.bands[3].lg_db && no_reference.missing.size() == 2);
    EXPECT_TRUE(!omni_alone.bands[3].j_lf && omni_alone.missing.size() == 4);
    EXPECT_NEAR(*measured({.lateral = heard.lateral, .is_green = true}).bands[3].lg_db, 10 * std::log10(late / kGreenAt10m), 0.1);
  }
}

TEST(LateralParameters, RefuseWhatDoesNotFit) {
  const std::vector<float> rir(1000, 0.1f), shorter(999, 0.1f), silent(100, 0.f);
  EXPECT_THROW(measure(rir, 16000.f, RirMeasurement{.lateral = shorter}), InputError);
  EXPECT_THROW(measure(rir, 16000.f, RirMeasurement{.reference_10m = silent}), InputError);
  EXPECT_THROW(parameter_request({"latteral"}, {}, "parameters", "snr"), InputError);
  EXPECT_THROW(parameter_request({"speech"}, {1, 2}, "parameters", "snr"), InputError);
  EXPECT_THROW(parameter_request({"stage"}, {1}, "parameters", "snr"), InputError);
  EXPECT_TRUE(parameter_request({"speech", "lateral"}, {1, 2, 3, 4, 5, 6, 7}, "parameters", "snr").speech);
}

// An exponential behind the direct sound: ratios of exp(-k t) between the limits.
TEST(StageSupport, OfDirectSoundAndAnExponential) {
  AcousticConfig config = lateral_config(1);
  const AcousticScene scene(rooms::shoe1(0.2, 1), config);
  ParameterRequest request;
  request.stage = true;
  for (std::uint32_t draw = 0; draw < 12; ++draw) {
    const double t60_s = uniform_between(5, 3 * draw, 0.3, 3), distance_m = uniform_between(5, 3 * draw + 1, 0.96, 1.04);
    const double reverberant = uniform_between(5, 3 * draw + 2, 1e-5, 1e-2), direct = 1 / std::pow(4 * std::numbers::pi * distance_m, 2);
    const double k = 6 * std::numbers::ln10 / t60_s, start_s = distance_m / 343.0;
    EnergyResponse response;
    response.late = make_histogram(scene);
    for (double t = 5e-6; t < 1.19; t += 1e-5)
      response.late.add(static_cast<float>(start_s + t), std::vector<float>{static_cast<float>(reverberant * k * 1e-5 * std::exp(-k * t))},
                        std::vector<float>{1, 0, 0, 0});
    add_arrival(response, ArrivalKind::direct, start_s, std::sqrt(direct), {0, 0, -1});
    const auto between = [&](double from_s, double to_s) { return reverberant * (std::exp(-k * from_s) - std::exp(-k * to_s)); };
    const BandMetrics band = measure(scene, response, request).bands[0];
    ASSERT_TRUE(band.st_early_db && band.st_late_db);
    const double first = direct + between(0, 0.01);
    EXPECT_NEAR(*band.st_early_db, 10 * std::log10(between(0.02, 0.1) / first), 0.05) << t60_s;
    EXPECT_NEAR(*band.st_late_db, 10 * std::log10(between(0.1, 1.0) / first), 0.05) << t60_s;
  }
}

TEST(StageSupport, NeedsAListenerAtOneMetreAndASecond) {
  ParameterRequest request;
  request.stage = true;
  const AcousticScene scene(rooms::shoe1(0.2, 1), lateral_config(1));
  for (const double distance_m : {0.5, 1.1, 3.0}) {
    EnergyResponse response;
    response.late = make_histogram(scene);
    response.late.add(0.05f, std::vector<float>{1.f}, std::vector<float>{1, 0, 0, 0});
    add_arrival(response, ArrivalKind::direct, distance_m / 343.0, 1, {0, 0, -1});
    const RoomMetrics metrics = measure(scene, response, request);
    EXPECT_FALSE(metrics.bands[0].st_early_db || metrics.bands[0].st_late_db) << distance_m;
    EXPECT_EQ(metrics.missing.size(), 2u);
  }
  EnergyResponse hidden;
  hidden.late = make_histogram(scene);
  hidden.late.add(0.05f, std::vector<float>{1.f}, std::vector<float>{1, 0, 0, 0});
  EXPECT_EQ(measure(scene, hidden, request).missing.size(), 2u);
  std::vector<float> rir(8000, 0.f);
  rir[100] = 1.f, rir[1000] = 0.1f;
  const RoomMetrics samples = measure(rir, 16000.f, RirMeasurement{.request = request, .is_green = true});
  EXPECT_NEAR(samples.bands[4].st_early_db.value_or(0), -20, 0.1);
  EXPECT_FALSE(samples.bands[4].st_late_db);
  EXPECT_EQ(samples.missing.size(), 1u);
}

// Third octaves: power-complementary filters of their own; an impulse reads the same in all, a tone in its own.
TEST(ThirdOctaves, ReadImpulsesAlikeAndTonesInTheirBand) {
  const BandLayout bands = BandLayout::third_octaves(44100);
  ASSERT_EQ(bands.size(), 21);
  EXPECT_NEAR(static_cast<double>(bands.centre_hz[10]), 1000, 1e-3);
  std::vector<float> rir(44100, 0.f);
  rir[4410] = 0.1f, rir[13230] = 0.05f;
  const RoomMetrics metrics = measure(rir, 44100.f, RirMeasurement{.bands = MeasuredBands::third_octaves, .is_green = true});
  ASSERT_EQ(metrics.bands.size(), 21u);
  for (std::size_t b = 6; b < 21; ++b) {
    EXPECT_NEAR(*metrics.bands[b].g_db, 10 * std::log10(0.0125 / kGreenAt10m), 0.02) << b;
    EXPECT_NEAR(*metrics.bands[b].drr_db, 6.0206, 0.05) << b;
  }
  for (std::uint32_t draw = 0; draw < 10; ++draw) {
    const auto own = static_cast<std::size_t>(uniform_between(6, 2 * draw, 4, 20));
    std::vector<float> tone(22050);
    for (std::size_t n = 0; n < tone.size(); ++n) {
      const double t = static_cast<double>(n) / 44100;
      tone[n] = static_cast<float>(std::exp(-6 * t) * std::sin(2 * std::numbers::pi * static_cast<double>(bands.centre_hz[own]) * t));
    }
    const RoomMetrics found =
        measure(tone, 44100.f, RirMeasurement{.direct_delay_s = 0, .bands = MeasuredBands::third_octaves, .is_green = true});
    for (std::size_t b = 4; b < 21; ++b) {
      if (b == own) continue;
      EXPECT_LT(*found.bands[b].g_db, *found.bands[own].g_db - 12) << own << " " << b;
    }
  }
}

}  // namespace
}  // namespace earshot
