// SPDX-License-Identifier: Apache-2.0
#include <gtest/gtest.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdint>
#include <limits>
#include <numbers>
#include <string>
#include <vector>

#include "sim/acoustics/core/histogram_sum.h"
#include "sim/acoustics/core/jackknife.h"
#include "sim/acoustics/geometry/field_grid.h"
#include "sim/acoustics/metrics/late_errors.h"
#include "sim/acoustics/metrics/room_metrics.h"
#include "sim/acoustics/source_field/field_image.h"
#include "sim/acoustics/tracers/listener_ray.h"
#include "sim/base/random.h"
#include "tests/support/acoustics/acoustic_engines.h"
#include "tests/support/acoustics/late_field.h"

/// How much float would cost, and what is left of it: each quantity against the same in double or long double.  The numbers are in
/// docs/evidence/precision.md; RecordProperty writes them to the XML of a run.
namespace earshot {
namespace {

void record(const std::string& name, double value) { testing::Test::RecordProperty(name, std::to_string(value * 1e9) + "e-9"); }

/// Largest relative error of backward sums in `Float` against long double.
template <class Float>
double backward_error(const std::vector<double>& energy) {
  Float sum = 0;
  long double exact = 0, worst = 0;
  for (std::size_t i = energy.size(); i-- > 0;) {
    sum += static_cast<Float>(energy[i]);
    exact += energy[i];
    if (exact > 0) worst = std::max(worst, std::fabs((static_cast<long double>(sum) - exact) / exact));
  }
  return static_cast<double>(worst);
}

TEST(Precision_SchroederIntegral, DoubleIsGoodToTenDigitsOfAMillionBins) {
  // A million bins, the most that a config allows: a rigid room, a slow decay over 120 dB, two slopes.
  constexpr std::size_t bins = 1'000'000;
  const char* name[] = {"rigid", "decay", "two_slopes"};
  for (int kind = 0; kind < 3; ++kind) {
    std::vector<double> energy(bins), edc(bins);
    for (std::size_t i = 0; i < bins; ++i) {
      const double t = static_cast<double>(i) / bins;
      energy[i] = kind == 0 ? 0.1 : kind == 1 ? std::pow(10.0, -12 * t) : std::pow(10.0, -30 * t) + 1e-3 * std::pow(10.0, -2 * t);
    }
    energy_decay_curve(energy, edc);
    long double exact = 0, worst = 0;
    for (std::size_t i = bins; i-- > 0;) {
      exact += energy[i];
      worst = std::max(worst, std::fabs((edc[i] - exact) / exact));
    }
    EXPECT_LT(static_cast<double>(worst), 1e-10) << name[kind];
    record(std::string("float_") + name[kind], backward_error<float>(energy));
    record(std::string("double_") + name[kind], static_cast<double>(worst));
    // A float sum is good enough for nothing that stands still: 1 % of a million equal bins.
    if (kind == 0) {
      EXPECT_GT(backward_error<float>(energy), 5e-3);
    }
  }
}

TEST(H40_TenMillionContributions, BlocksInFloatSummedInDoubleKeepFiveDigits) {
  // Ten million times 0.1: a single float sum gains 8.8 % (O-25).  Tracers add blocks of 256 rays in float, their sums in double.
  constexpr int blocks = 40'000, per_block = 256;
  const std::array<float, 1> energy = {0.1f}, sh = {1.f};
  EnergyHistogram part(1, 1, 0, 1.f), naive = part, result = part;
  HistogramSum sum(part);
  for (int block = 0; block < blocks; ++block) {
    part.clear();
    for (int i = 0; i < per_block; ++i) part.add(0.5f, energy, sh);
    sum.add(part);
  }
  sum.write(result);
  for (int i = 0; i < 10'000'000; ++i) naive.add(0.5f, energy, sh);
  const double exact = static_cast<double>(0.1f) * blocks * per_block;
  EXPECT_LT(std::abs(result.energy(0, 0) / exact - 1), 1e-5);
  const double naive_error = naive.energy(0, 0) / (1e7 * static_cast<double>(0.1f)) - 1;
  EXPECT_NEAR(naive_error, 0.088, 0.002);
  record("float", naive_error);
  record("blocks", result.energy(0, 0) / exact - 1);
}

TEST(H40_TenMillionContributions, ARigidClosetInCoarseBinsHoldsWhatFineBinsHold) {
  // Half a metre of rigid walls: a ray meets 800 of them in half a second, so that a bin of 0.1 s gets 36,000 contributions from each
  // block. Bins a thousand times finer see the same paths, and a thousandth of the additions.
  const auto room = rooms::box(0.5, 0.4, 0.3, rooms::uniform_walls(0, 1));
  for (const int source_rays : {0, 512}) {
    AcousticConfig config = rooms::plain_config();
    config.rays = 512;
    config.source_rays = source_rays;
    config.rir_length_s = 0.5f;
    std::array<double, 2> total{};
    for (const bool fine : {false, true}) {
      config.time_bin_s = fine ? 1e-4f : 0.1f;
      const engines::Heard heard(source_rays > 0 ? engines::Engine::bidirectional : engines::Engine::path_tracer, room, config,
                                 rooms::point(0.11, 0.12, 0.13));
      total[fine ? 1 : 0] = engines::late_energy(heard.at(rooms::point(0.41, 0.3, 0.2)));
    }
    EXPECT_NEAR(total[0] / total[1], 1.0, 1e-5) << source_rays;
    record(source_rays > 0 ? "bidirectional" : "path_tracer", total[0] / total[1] - 1);
  }
}

TEST(Precision_FieldCells, FloatLosesDigitsThatDoubleKeeps) {
  // What cells of a field add up: lengths times energies of segments, spread as photons spread them.  2^23 photons in a room of one cell
  // are more than ten million in one bin.
  for (const int segments : {10'000, 100'000, 1'000'000, 10'000'000}) {
    float in_float = 0;
    double in_double = 0;
    long double exact = 0;
    for (int i = 0; i < segments; ++i) {
      const auto u = RandomStream(1, Purpose::test, static_cast<std::uint32_t>(i)).uniform2(0);
      const float energy = -std::log(1.f - u[0]), length_m = u[1];
      in_float += length_m * energy;
      in_double += static_cast<double>(length_m * energy);
      exact += static_cast<long double>(length_m * energy);
    }
    const auto float_error = static_cast<double>(std::fabs(static_cast<long double>(in_float) / exact - 1));
    const auto double_error = static_cast<double>(std::fabs(static_cast<long double>(in_double) / exact - 1));
    record("float_" + std::to_string(segments), float_error);
    record("double_" + std::to_string(segments), double_error);
    EXPECT_LT(double_error, 1e-11) << segments;
    if (segments == 10'000'000) {
      EXPECT_GT(float_error, 1e-4);
    }
  }
}

TEST(Precision_FieldValues, BfloatRoundsToNearestAtAnyScale) {
  double worst = 0, mean = 0;
  int count = 0;
  for (int exponent = -120; exponent <= 120; exponent += 3) {
    for (std::uint32_t i = 0; i < 1000; ++i) {
      const float value = std::ldexp(1.f + RandomStream(2, Purpose::test, i).uniform(0), exponent);
      const double error = static_cast<double>(from_field_value(to_field_value(value))) / static_cast<double>(value) - 1;
      worst = std::max(worst, std::abs(error));
      mean += error;
      ++count;
    }
  }
  EXPECT_LE(worst, 0x1p-8);  // half of the last of eight digits
  EXPECT_LT(std::abs(mean / count), 2e-5);
  record("worst", worst);
  record("mean", mean / count);
  EXPECT_EQ(from_field_value(to_field_value(0.f)), 0.f);
  for (const float value : {std::numeric_limits<float>::min(), 1e38f, 3e38f}) {
    EXPECT_TRUE(std::isfinite(from_field_value(to_field_value(value)))) << value;
    EXPECT_NEAR(from_field_value(to_field_value(value)) / value, 1.f, 0.004f) << value;
  }
  // A decay of T = 0.5 s in 4 ms bins: level and decay time with and without rounding.
  std::vector<double> exact(125), rounded(125);
  for (std::size_t i = 0; i < exact.size(); ++i) {
    exact[i] = 0.017 * std::exp(-13.8155 / 0.5 * static_cast<double>(i) * 0.004);
    rounded[i] = static_cast<double>(from_field_value(to_field_value(static_cast<float>(exact[i]))));
  }
  const BandMetrics a = measure_band(exact, 0.004, 0), b = measure_band(rounded, 0.004, 0);
  EXPECT_NEAR(*b.t30_s / *a.t30_s, 1.0, 5e-4);
  EXPECT_NEAR(*b.g_db, *a.g_db, 0.017);  // 0.4 % at most
  record("t30", *b.t30_s / *a.t30_s - 1);
}

TEST(Precision_FieldBlend, WeightsAddUpToOneAndAreTheTrilinearOnes) {
  // Without inner walls the cells are the boxes of a known grid: the weights in double.
  const auto room = rooms::shoe1(0.2, 1);  // x 0..5, y 0..3 (up), z -4..0
  const FieldGrid grid(*room, 1.f);
  ASSERT_EQ(grid.size(), 60u);
  const std::array<int, 3> boxes = {5, 3, 4};
  const std::array<double, 3> low = {0, 0, -4};
  double worst = 0;
  for (std::uint32_t i = 0; i < 20'000; ++i) {
    const auto u = RandomStream(3, Purpose::test, i).uniform4(0);
    std::array<double, 3> place{};
    for (std::size_t axis = 0; axis < 3; ++axis) place[axis] = low[axis] + static_cast<double>(u[axis]) * boxes[axis];
    // Some exactly between cells or in their middle, some a hair beside.
    const std::size_t picked = i % 3;
    const double inner = std::clamp(std::round(2 * place[picked]) / 2, low[picked] + 0.5, low[picked] + boxes[picked] - 0.5);
    if (i % 5 == 0) place[picked] = inner + (i % 2 == 0 ? 0.0 : 1e-6);
    const glm::vec3 point(static_cast<float>(place[0]), static_cast<float>(place[1]), static_cast<float>(place[2]));
    std::array<FieldGrid::CellWeight, 8> shares;
    const std::size_t count = grid.blend(point, shares);
    ASSERT_GT(count, 0u);
    double sum = 0;
    std::vector<double> weight(grid.size(), 0.0);
    for (std::size_t k = 0; k < count; ++k) {
      ASSERT_GT(shares[k].weight, 0.f);
      ASSERT_LE(shares[k].weight, 1.0000002f);
      sum += static_cast<double>(shares[k].weight);
      weight[shares[k].cell] += static_cast<double>(shares[k].weight);
    }
    worst = std::max(worst, std::abs(sum - 1));
    for (int corner = 0; corner < 8; ++corner) {
      double expected = 1;
      std::array<int, 3> index{};
      for (std::size_t axis = 0; axis < 3; ++axis) {
        const double from_centre = static_cast<double>(point[static_cast<int>(axis)]) - low[axis] - 0.5, floor = std::floor(from_centre);
        const int side = corner >> axis & 1;
        expected *= side ? from_centre - floor : 1 - (from_centre - floor);
        index[axis] = std::clamp(static_cast<int>(floor) + side, 0, boxes[axis] - 1);
      }
      weight[static_cast<std::size_t>((index[0] * boxes[1] + index[1]) * boxes[2] + index[2])] -= expected;
    }
    for (const double left : weight) ASSERT_NEAR(left, 0.0, 2e-6) << i;
  }
  EXPECT_LT(worst, 1e-6);
  record("sum_of_weights", worst);
}

TEST(Precision_FieldBlend, BesideAWallTheCellsOfOneSideStandForAll) {
  // Two closed rooms, and a listener as near to the wall between them as floats allow: of eight cells those behind the wall are not seen,
  // and what is left of the weights is scaled to one however little it is.  What is heard stays continuous.
  TriangleMesh mesh;
  rooms::append_box(mesh, {0, 0, 0}, {3.3, 3, 2.5}, 0);
  rooms::append_box(mesh, {3.4, 0, 0}, {7, 3, 2.5}, 0);
  const auto room = rooms::scene_of(mesh, {Material::uniform("wall", 0.1f, 1.f)});
  const engines::Heard heard(engines::Engine::field, room, engines::plain(), rooms::point(1, 1, 1), 2048);
  const double at_wall = engines::late_energy(heard.at(rooms::point(3.3 - 1e-3, 1.3, 1.2)));
  ASSERT_GT(at_wall, 0);
  for (const double gap_m : {1e-3, 1e-4, 1e-5, 1e-6}) {
    const EnergyResponse response = heard.at(rooms::point(3.3 - gap_m, 1.3, 1.2));
    engines::expect_sound(response);
    EXPECT_NEAR(engines::late_energy(response) / at_wall, 1.0, 5e-3) << gap_m;
  }
}

TEST(Precision_Jackknife, KeepsSixDigitsOfASpreadOfAMillionth) {
  for (const double scale : {1e-30, 1e-12, 1.0, 1e20}) {
    std::vector<std::optional<double>> values;
    long double mean = 0, squares = 0;
    std::vector<double> plain;
    for (std::uint32_t i = 0; i < 16; ++i) {
      plain.push_back(scale * (1 + 1e-6 * static_cast<double>(RandomStream(4, Purpose::test, i).uniform(0))));
      values.emplace_back(plain.back());
      mean += static_cast<long double>(plain.back()) / 16;
    }
    for (const double value : plain) squares += (value - mean) * (value - mean);
    const auto exact = static_cast<double>(std::sqrt(15.0L / 16 * squares));
    EXPECT_NEAR(*jackknife_error(values) / exact, 1.0, 1e-6) << scale;
    // Float cannot represent this spread.
    float sum = 0, square_sum = 0;
    for (const double value : plain)
      sum += static_cast<float>(value / scale), square_sum += static_cast<float>(value / scale) * static_cast<float>(value / scale);
    record("float_variance", (square_sum / 16 - sum / 16 * (sum / 16)) / static_cast<double>(squares / scale / scale / 16) - 1);
  }
  EXPECT_FALSE(jackknife_error(std::vector<std::optional<double>>{1.0, std::nullopt}));
  EXPECT_EQ(*jackknife_error(std::vector<std::optional<double>>(8, 0.25)), 0.0);
}

TEST(Precision_PathLength, AMinuteOfReflectionsStaysWithinHalfABin) {
  // Rays add up their way in float: 20 km by steps of 2.5 m.  A bin of a millisecond is 34 cm.
  double worst_m = 0;
  for (std::uint32_t ray = 0; ray < 200; ++ray) {
    float path_m = 0;
    double exact_m = 0;
    for (std::uint32_t step = 0; exact_m < 60 * 343; ++step) {
      const float segment_m = 5 * RandomStream(5, Purpose::test, ray, step).uniform(0);
      path_m += segment_m;
      exact_m += static_cast<double>(segment_m);
    }
    worst_m = std::max(worst_m, std::abs(static_cast<double>(path_m) - exact_m));
  }
  EXPECT_LT(worst_m, 0.17);  // half of that bin
  record("metres", worst_m);
}

TEST(Precision_AirPerBin, AProductOfAMillionFactorsIsTheExponential) {
  constexpr int bins = 1'000'000;
  EnergyHistogram histogram(bins, 1, 0, 6e-5f);
  for (float& value : histogram.values()) value = 1.f;
  const std::array<float, 1> per_m = {0.001f};
  histogram.attenuate(per_m, 343.f);
  float product = 1.f;
  const auto factor = static_cast<float>(std::exp(-0.001 * 343.0 * 6e-5));
  double worst = 0, worst_float = 0;
  for (int bin = 0; bin < bins; ++bin, product *= factor) {
    const double exact = std::exp(-static_cast<double>(0.001f) * 343.0 * (bin + 0.5) * static_cast<double>(6e-5f));
    worst = std::max(worst, std::abs(histogram.energy(bin, 0) / exact - 1));
    worst_float = std::max(worst_float, std::abs(static_cast<double>(product) / std::exp(-0.001 * 343.0 * bin * 6e-5) - 1));
  }
  EXPECT_LT(worst, 2e-7);  // the rounding of the stored value
  EXPECT_GT(worst_float, 1e-4);
  record("float", worst_float);
  record("double", worst);
}

TEST(Precision_BandWeights, StayNormalisedOverAThousandBounces) {
  // Hero weights have a mean of one over bands (listener_ray.h).  Rounding is put right at each diffuse bounce and grows between.
  using Ray = listener_ray::RayState<8>;
  constexpr int bands = 7;
  alignas(32) const float scattering[8] = {0.05f, 0.1f, 0.2f, 0.3f, 0.5f, 0.7f, 0.9f, 0};
  double worst = 0, mean = 0;
  std::array<double, bands> energy{};
  constexpr std::uint32_t rays = 2000, bounces = 1000;
  for (std::uint32_t i = 0; i < rays; ++i) {
    Ray ray;
    for (int b = 0; b < 8; ++b) ray.weight[b] = ray.throughput[b] = b < bands ? 1.f : 0.f;
    for (std::uint32_t bounce = 0; bounce < bounces; ++bounce) {
      for (int b = 0; b < 8; ++b) ray.reflected[b] = ray.throughput[b];
      (void)listener_ray::pick_lobe(ray, scattering, bands, RandomStream(6, Purpose::test, i, bounce).uniform(0));
      if (bounce == 9)
        for (std::size_t b = 0; b < bands; ++b) energy[b] += static_cast<double>(ray.throughput[b]) / rays;
    }
    double sum = 0;
    for (int b = 0; b < bands; ++b) {
      ASSERT_TRUE(std::isfinite(ray.weight[b]) && std::isfinite(ray.throughput[b]));
      sum += static_cast<double>(ray.weight[b]);
    }
    worst = std::max(worst, std::abs(sum / bands - 1));
    mean += std::abs(sum / bands - 1) / rays;
  }
  EXPECT_LT(mean, 1e-4);
  for (const double of_band : energy) EXPECT_NEAR(of_band, 1.0, 0.2);  // all lobes together keep the energy
  record("worst", worst);
  record("mean", mean);
}

TEST(X_LobeChoice, WhatIsLeftOfARandomNumberStaysBelowOne) {
  // A wall that passes p: the rest of the number picks among the lobes.  Rounded up to 1 it would pick the mirror of a wall without one,
  // and divide by its probability of zero.
  const auto room = rooms::scene_of(
      [] {
        TriangleMesh mesh;
        rooms::append_box(mesh, {0, 0, 0}, {1, 1, 1}, 0);
        return mesh;
      }(),
      {Material::uniform("wall", 0.5f, 1.f, 0.3f)});
  AcousticConfig config = rooms::plain_config();
  config.transmission = Switch::on;
  for (int permille = 1; permille < 1000; ++permille) {
    float random = 0x1.fffffep-1f;
    const float probability = static_cast<float>(permille) / 1000.f, scale = 1.f / (1.f - probability);
    if ((random - probability) * scale < 1.f) continue;
    // Such quotients exist; the product must not hand them on.
    const auto wall = rooms::scene_of(
        [] {
          TriangleMesh mesh;
          rooms::append_box(mesh, {0, 0, 0}, {1, 1, 1}, 0);
          return mesh;
        }(),
        {Material::uniform("wall", 1.f, 1.f, probability)});
    const AcousticScene scene(wall, config);
    const EarlyCandidates candidates(scene, glm::vec3(0.5f, 0.5f, -0.5f));
    const listener_ray::Trace trace{.scene = scene,
                                    .candidates = candidates,
                                    .emission = nullptr,
                                    .walls = &scene.reflection_model(),
                                    .source = {},
                                    .listener = {},
                                    .directions = {0, 0},
                                    .num_rays = 1,
                                    .max_bounces = 1,
                                    .carried_order = 0,
                                    .sh_order = 0,
                                    .num_coefficients = 1,
                                    .weight_per_ray = 1,
                                    .max_path_m = 1,
                                    .seconds_per_m = 1,
                                    .stage_m = 1,
                                    .least_distance2_m2 = 0,
                                    .source_radius_m = 0,
                                    .source_spread_m = 0,
                                    .diffuse_last_segment = true};
    listener_ray::RayState<8> ray;
    for (int b = 0; b < 8; ++b) ray.weight[b] = ray.throughput[b] = ray.reflected[b] = b == 0 ? 1.f : 0.f;
    (void)listener_ray::pick_wall(trace, ray, 0, random);
    EXPECT_LT(random, 1.f) << permille;
  }
}

}  // namespace
}  // namespace earshot
