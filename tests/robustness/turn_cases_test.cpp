// SPDX-License-Identifier: Apache-2.0
// Hard cases of how a listener is turned: drift, poles, seams, a full circle.

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <complex>
#include <cstdio>
#include <glm/geometric.hpp>
#include <glm/gtc/quaternion.hpp>
#include <limits>
#include <numbers>

#include "sim/acoustics/synthesis/rir_synthesis.h"
#include "sim/base/errors.h"
#include "tests/support/envs/env_cases.h"
#include "tests/support/envs/nav_scenes.h"

namespace earshot {
namespace {

constexpr double kDegree = std::numbers::pi / 180;

TEST(H53_Quaternion, IsNormalisedOrRefused) {
  for (const double scale : {1e-6, 0.3, 7.0, 1e9}) {
    const ListenerOrientation orientation(glm::dquat(scale * std::cos(0.4), 0, scale * std::sin(0.4), 0));
    const glm::vec3 expected = ListenerOrientation(0.8).local_to_world({0, 0, -1}), got = orientation.local_to_world({0, 0, -1});
    EXPECT_NEAR(glm::length(got - expected), 0.f, 1e-6f) << scale;
    const auto s = static_cast<float>(scale);
    if (s > 1e6f || s < 1e-5f) continue;
    EXPECT_NEAR(heading_of({0, s * std::sin(0.4f), 0, s * std::cos(0.4f)}), 0.8, 1e-6) << scale;
  }
  const double nan = std::numeric_limits<double>::quiet_NaN(), inf = std::numeric_limits<double>::infinity();
  for (const glm::dquat& bad : {glm::dquat(0, 0, 0, 0), glm::dquat(nan, 0, 0, 1), glm::dquat(1, inf, 0, 0)})
    EXPECT_THROW(ListenerOrientation{bad}, InputError);
}

// Ten degrees at a time: what floats would do, and what is done.
TEST(H54_TurnDrift, HeadingsAreWholeTurns) {
  TaskConfig task;
  task.max_steps = 1'000'000;
  const Navmesh navmesh(floor_with(6, 6, {}), {});
  const GeodesicField field(navmesh, {5, 0, 5});
  AvNavState state;
  state.begin(task, field, *navmesh.snap({3, 0, 3}), 0.7, 10);
  const glm::vec3 position = state.pose(task).position;

  const auto half = static_cast<float>(5 * kDegree);
  const glm::quat step(std::cos(half), 0, std::sin(half), 0);
  glm::quat turned(1, 0, 0, 0);
  float yaw_rad = 0;
  for (int turns = 1; turns <= 36000; ++turns) {
    state.step(task, navmesh, field, Action::left);
    turned = turned * step;
    yaw_rad += 10.f * static_cast<float>(kDegree);
    if (turns != 36 && turns != 3600 && turns != 36000) continue;
    EXPECT_EQ(state.pose(task).heading_rad, 0.7) << turns;  // a whole number of circles: the same bits
    EXPECT_EQ(state.pose(task).position, position);
    const double norm_error = std::abs(static_cast<double>(glm::dot(turned, turned)) - 1.0);
    const double yaw_error = std::abs(static_cast<double>(yaw_rad) - turns * 10 * kDegree);
    std::printf("after %d turns of 10 degrees: heading 0 off; float quaternion's norm %.1e off, float yaw %.1e rad off\n", turns,
                norm_error, yaw_error);
    if (turns == 36000) {
      EXPECT_GT(norm_error, 1e-5);
      EXPECT_GT(yaw_error, 1e-3);
    }
  }
}

// No walk drifts: a thousand times 36 turns and a step forth; each circle's step is exactly the one before, on the free floor.
TEST(H55_YawInRadians, StaysWithinACircleAndKeepsItsDirection) {
  TaskConfig task;
  task.max_steps = 1'000'000;
  const Navmesh navmesh(floor_with(60, 6, {}), {});
  const GeodesicField field(navmesh, {59, 0, 5});
  AvNavState state;
  state.begin(task, field, *navmesh.snap({1, 0, 3}), -std::numbers::pi / 2, 10);  // along +x
  for (int circle = 0; circle < 300; ++circle) {
    for (int turn = 0; turn < 36; ++turn) {
      state.step(task, navmesh, field, Action::right);
      ASSERT_LT(std::abs(state.pose(task).heading_rad), 2 * std::numbers::pi + 1.6);
    }
    state.step(task, navmesh, field, Action::forward);
  }
  const glm::vec3 end = state.pose(task).position;
  EXPECT_NEAR(end.x, 1 + 300 * 0.15, 300 * 4e-6);  // a float at 46 m has steps of 3.8e-6
  EXPECT_NEAR(end.z, 3, 1e-4);                     // sideways, a heading off by 1e-6 would show as 4.5e-5
}

TEST(H56_GimbalLock, FramesStayOrthonormal) {
  const auto head = Hrtf::rigid_sphere(16000.f);
  std::vector<std::complex<float>> left(static_cast<std::size_t>(head->fft_size()) / 2 + 1), right(left.size());
  for (const double pitch_deg : {-90.0, -89.9999999, 0.0, 89.9999999, 90.0, 180.0})
    for (const double roll_deg : {-180.0, -90.0, 0.0, 37.0, 90.0})
      for (const double heading_deg : {0.0, 90.0, 123.0, 359.9}) {
        const ListenerOrientation orientation(heading_deg * kDegree, pitch_deg * kDegree, roll_deg * kDegree);
        const glm::vec3 axes[] = {orientation.world_to_local({1, 0, 0}), orientation.world_to_local({0, 1, 0}),
                                  orientation.world_to_local({0, 0, 1})};
        for (int i = 0; i < 3; ++i)
          for (int j = 0; j < 3; ++j) ASSERT_NEAR(glm::dot(axes[i], axes[j]), i == j ? 1.f : 0.f, 3e-7f);
        ASSERT_NEAR(glm::dot(glm::cross(axes[0], axes[1]), axes[2]), 1.f, 3e-7f);  // no mirror
        ASSERT_NEAR(
            glm::length(orientation.local_to_world(orientation.world_to_local({0.36f, 0.48f, 0.8f})) - glm::vec3(0.36f, 0.48f, 0.8f)), 0.f,
            5e-7f);
        head->spectra(axes[2], left, right);
        for (const auto& ear : {left, right})
          for (const auto value : ear) ASSERT_TRUE(std::isfinite(value.real()) && std::isfinite(value.imag()));
      }
}

/// Energy of one ear in an octave about centre_hz.
double octave_energy(const Hrtf& head, std::span<const std::complex<float>> ear, double centre_hz) {
  const double bin_hz = static_cast<double>(head.sample_rate_hz()) / head.fft_size();
  double sum = 0;
  for (std::size_t k = 1; k < ear.size(); ++k) {
    const double hz = static_cast<double>(k) * bin_hz;
    if (hz > centre_hz / std::numbers::sqrt2 && hz <= centre_hz * std::numbers::sqrt2) sum += std::norm(std::complex<double>(ear[k]));
  }
  return sum;
}

// Over both poles, through the seam at 180 degrees and along the horizon: an ear's level in an octave changes by at most 1 dB per degree.
TEST(H57_HrtfDirections, ChangeByAtMostADecibelPerDegree) {
  const auto head = Hrtf::rigid_sphere(16000.f);
  const std::size_t bins = static_cast<std::size_t>(head->fft_size()) / 2 + 1;
  std::vector<std::complex<float>> ears[2] = {std::vector<std::complex<float>>(bins), std::vector<std::complex<float>>(bins)};
  double worst_db = 0;
  const auto circle = [&](glm::dvec3 from, glm::dvec3 over) {
    std::vector<double> before;
    for (double t = 0; t <= 361; t += 0.5) {
      const glm::vec3 direction(std::cos(t * kDegree) * from + std::sin(t * kDegree) * over);
      head->spectra(direction, ears[0], ears[1]);
      std::vector<double> now;
      for (const auto& ear : ears)
        for (const double centre_hz : {500.0, 1000.0, 2000.0, 4000.0}) now.push_back(10 * std::log10(octave_energy(*head, ear, centre_hz)));
      for (std::size_t i = 0; i < before.size(); ++i) worst_db = std::max(worst_db, std::abs(now[i] - before[i]) / 0.5);
      before = now;
    }
  };
  circle({0, 0, -1}, {1, 0, 0});  // the horizon, with the seam behind
  circle({0, 0, -1}, {0, 1, 0});  // the median plane, over both poles
  circle({1, 0, 0}, {0, 1, 0});   // through both ears
  circle({std::sqrt(0.5), 0, -std::sqrt(0.5)}, {0, 1, 0});
  std::printf("largest change of an octave's level: %.2f dB per degree\n", worst_db);
  EXPECT_LT(worst_db, 1.0);
  EXPECT_GT(worst_db, 0.02);  // the head does shadow
}

// A full turn in 36 steps: the RIR of the last heading has the bits of the first, with cached late sound and without.
TEST(H58_FullTurn, ComesBackToTheSameBits) {
  EnvConfig config = quick_env_config();
  const auto cache = make_scene_cache(config);
  const auto source = cache->source("shoebox:6x3x5@0.2", {4, 0, 3}, 1.5f);
  EnergyResponse response;
  compute_energy_response(source->scene->acoustics, source->candidates, {1.2f, 1.5f, 1.1f}, response);
  RirSynthesizer synthesizer(make_synthesis_tables(config.acoustics, BandLayout::octaves(16000.f), ChannelLayout::binaural, nullptr));
  AvNavState state;
  state.begin(config.task, source->field, *source->scene->navmesh.snap({1.2f, 0, 1.1f}), 0.123456789, 10);
  Rir first, now;
  LateSound kept;
  synthesizer.render(response, state.pose(config.task).heading_rad, 7, first);
  TaskConfig relaxed = config.task;
  relaxed.max_steps = 1000;
  for (int turn = 1; turn <= 72; ++turn) {
    state.step(relaxed, source->scene->navmesh, source->field, Action::left);
    synthesizer.render(response, state.pose(relaxed).heading_rad, 7, now, &kept);
    if (turn % 36 == 0) {
      ASSERT_EQ(now.samples, first.samples) << turn;
    } else if (turn % 36 == 18) {
      ASSERT_NE(now.samples, first.samples);
    }
  }
}

/// Right minus left arrival in seconds at low frequency, from the phase between the ears: positive for a source on the left.
double time_difference_s(const Hrtf& head, double azimuth_deg) {
  const std::size_t bins = static_cast<std::size_t>(head.fft_size()) / 2 + 1;
  std::vector<std::complex<float>> left(bins), right(bins);
  const double a = azimuth_deg * kDegree;  // counter-clockwise from the front
  head.spectra({static_cast<float>(-std::sin(a)), 0.f, static_cast<float>(-std::cos(a))}, left, right);
  const double bin_hz = static_cast<double>(head.sample_rate_hz()) / head.fft_size();
  const auto k = static_cast<std::size_t>(std::lround(250.0 / bin_hz));
  return std::arg(std::complex<double>(left[k]) * std::conj(std::complex<double>(right[k]))) /
         (2 * std::numbers::pi * static_cast<double>(k) * bin_hz);
}

// Behind the head, from 170 to 190 degrees: the sign changes once, through zero, without a jump.
TEST(H59_BehindTheHead, TheTimeDifferenceGoesThroughZero) {
  const auto head = Hrtf::rigid_sphere(16000.f);
  EXPECT_GT(time_difference_s(*head, 90), 5e-4);  // 8.75 cm: Woodworth 0.66 ms, more at low frequency
  double before_s = time_difference_s(*head, 170);
  EXPECT_GT(before_s, 0);
  int sign_changes = 0;
  for (double azimuth_deg = 170.1; azimuth_deg < 190.05; azimuth_deg += 0.1) {
    const double now_s = time_difference_s(*head, azimuth_deg);
    EXPECT_LT(now_s, before_s + 1e-8) << azimuth_deg;
    EXPECT_LT(std::abs(now_s - before_s), 3e-6) << azimuth_deg;  // d/d azimuth of 3 a/c sin: 0.77 ms per radian is 1.3 us per 0.1 degree
    sign_changes += (now_s < 0) != (before_s < 0) ? 1 : 0;
    before_s = now_s;
  }
  EXPECT_EQ(sign_changes, 1);
  for (const double azimuth_deg : {180.0, -180.0, 540.0}) EXPECT_NEAR(time_difference_s(*head, azimuth_deg), 0.0, 2e-8) << azimuth_deg;
  EXPECT_NEAR(time_difference_s(*head, 175), -time_difference_s(*head, 185), 2e-8);
}

}  // namespace
}  // namespace earshot
