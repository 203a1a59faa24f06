// SPDX-License-Identifier: Apache-2.0
// Noise of pose sensors and of actuation, and the map with the path: statistics, and the same bits wherever an env runs.
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cmath>
#include <numbers>

#include "envs/sensors/sensor_rows.h"
#include "sim/base/errors.h"
#include "tests/support/envs/vector_semantics.h"

namespace earshot {
namespace {

constexpr double kRadians = std::numbers::pi / 180;

/// Mean and standard deviation of samples, each with its standard error if they are Gaussian with this sigma.
struct Spread {
  double sum = 0, squares = 0, count = 0;
  void add(double value) {
    sum += value;
    squares += value * value;
    ++count;
  }
  void expect(double mean, double sigma) const {
    const double found = sum / count, deviation = std::sqrt(squares / count - found * found);
    // Four standard errors: the numbers are fixed by the seed, and a sigma that is off by a tenth shows.
    ASSERT_LT(4 / std::sqrt(2 * count), 0.1);
    EXPECT_NEAR(found, mean, 4 * sigma / std::sqrt(count));
    EXPECT_NEAR(deviation, sigma, 4 * sigma / std::sqrt(2 * count));
  }
};

std::vector<float> floats_of(const BatchedEnv& env, std::string_view name, int row) {
  return row_of(as_floats(env.rows(name)), env.num_envs(), row);
}

class WayNoise : public VectorSemantics {
 protected:
  /// Nothing to see or hear: thousands of steps take no time.
  static EnvConfig of_the_way() {
    EnvConfig config = quick_env_config();
    config.observation.depth = config.observation.spectrogram = false;
    config.observation.gps_compass = config.observation.pose = true;
    return config;
  }
  static void make_noisy(EnvConfig& config) {
    config.observation.pose_noise = {.position_m = 0.1f, .heading_deg = 3.f};
    config.task.actuation_noise = {.forward_m = 0.02f, .turn_deg = 1.f, .veer_deg = 0.5f};
    config.observation.topdown_map = true;
    config.observation.map = {.size_px = 24, .metres_per_px = 0.25f, .goal = true};
  }
};

TEST_F(WayNoise, PoseReadingsHaveTheSigmasOfTheConfig) {
  EnvConfig plain = of_the_way(), noisy = plain;
  noisy.observation.pose_noise = {.position_m = 0.2f, .heading_deg = 5.f};
  BatchedEnv a = make(8, plain), b = make(8, noisy);
  a.reset();
  b.reset();
  Spread ahead, right, heading;
  for (int i = 0; i < 400; ++i) {
    step(a, i);
    step(b, i);
    for (int row = 0; row < 8; ++row) {
      const auto x = floats_of(a, "gps_compass", row), y = floats_of(b, "gps_compass", row), z = floats_of(b, "pose", row);
      ahead.add(static_cast<double>(y[0] - x[0]));
      right.add(static_cast<double>(y[1] - x[1]));
      heading.add(std::remainder(static_cast<double>(y[2] - x[2]), 2 * std::numbers::pi));
      for (std::size_t k = 0; k < 3; ++k) ASSERT_EQ(y[k], z[k]);  // one reading for both sensors
      ASSERT_EQ(z[3], floats_of(a, "pose", row)[3]);
    }
  }
  ahead.expect(0, 0.2);
  right.expect(0, 0.2);
  heading.expect(0, 5 * kRadians);
}

TEST(ActuationNoise, ErrorsHaveTheSigmasOfTheConfig) {
  const ActuationNoise noise{.forward_m = 0.03f, .turn_deg = 2.f, .veer_deg = 1.f};
  Spread distance, veer, turn;
  for (std::uint32_t i = 0; i < 4000; ++i) {
    const RandomStream random(5, Purpose::actuation_noise, i);
    const ActuationError forward = draw_actuation_error(noise, Action::forward, random);
    distance.add(static_cast<double>(forward.forward_m));
    veer.add(forward.turn_rad);
    const ActuationError left = draw_actuation_error(noise, Action::left, random);
    turn.add(left.turn_rad);
    ASSERT_EQ(left.forward_m, 0.f);
    const ActuationError stop = draw_actuation_error(noise, Action::stop, random);
    ASSERT_EQ(stop.forward_m, 0.f);
    ASSERT_EQ(stop.turn_rad, 0.0);
  }
  distance.expect(0, static_cast<double>(0.03f));
  veer.expect(0, kRadians);
  turn.expect(0, 2 * kRadians);
}

// What agents do in an open room, action by action.
TEST_F(WayNoise, StepsOfAgentsHaveTheErrorsOfTheConfig) {
  EnvConfig config = of_the_way();
  config.task.max_steps = 1000;
  config.task.actuation_noise = {.forward_m = 0.015f, .turn_deg = 2.f, .veer_deg = 1.f};
  BatchedEnv env(config, make_set({room_episode("shoebox:30x3x30@0.5", {15, 0, 15}, 0, {2, 0, 2}, "synth:noise")}), scenes_, 16);
  env.reset();
  Spread distance, veer, turn;
  for (int i = 0; i < 200; ++i) {
    std::vector<Pose> before;
    for (int row = 0; row < 16; ++row) before.push_back(env.agent(row).pose);
    const Action action = i % 2 == 0 ? Action::forward : Action::left;
    env.step(std::vector<std::int32_t>(16, static_cast<std::int32_t>(action)));
    for (int row = 0; row < 16; ++row) {
      const Pose now = env.agent(row).pose, was = before[static_cast<std::size_t>(row)];
      const double turned = std::remainder(now.heading_rad - was.heading_rad, 2 * std::numbers::pi);
      ASSERT_FALSE(env.collided()[static_cast<std::size_t>(row)]);
      if (action == Action::left) {
        ASSERT_EQ(now.position, was.position);
        turn.add(turned);
      } else {
        distance.add(
            std::hypot(static_cast<double>(now.position.x - was.position.x), static_cast<double>(now.position.z - was.position.z)));
        veer.add(turned);
      }
    }
  }
  distance.expect(0.15, 0.015);
  veer.expect(0, kRadians);
  turn.expect(10 * kRadians, 2 * kRadians);
}

TEST_F(WayNoise, ZeroNoiseChangesNoBit) {
  EnvConfig noisy = config_;
  noisy.observation.pose_noise = {.position_m = 0.1f};
  noisy.task.actuation_noise = {.veer_deg = 0.f};
  BatchedEnv plain = make(3, config_), other = make(3, noisy);
  plain.reset();
  other.reset();
  for (int i = 0; i < 30; ++i) {
    step(plain, i);
    step(other, i);
    for (int row = 0; row < 3; ++row) {
      EXPECT_EQ(plain.agent(row).pose.position, other.agent(row).pose.position);
      EXPECT_EQ(floats_of(plain, "spectrogram", row), floats_of(other, "spectrogram", row));
      EXPECT_EQ(floats_of(plain, "gps_compass", row)[2], floats_of(other, "gps_compass", row)[2]);
      EXPECT_NE(floats_of(plain, "gps_compass", row)[0], floats_of(other, "gps_compass", row)[0]);
    }
  }
}

// All sensors, with noise of everything and the map.
TEST_F(WayNoise, SnapshotsThreadsAndSplitsChangeNoBit) {
  make_noisy(config_);
  BatchedEnv a = make(4, config_);
  config_.threads = 3;
  BatchedEnv b = make(2, config_), first(config_, set_, scenes_, 1, 0, 4), rest(config_, set_, scenes_, 3, 1, 4);
  for (BatchedEnv* env : {&a, &b, &first, &rest}) env->reset();
  for (int i = 0; i < 40; ++i) {
    step(a, i);
    step(first, i);
    rest.step(std::vector<std::int32_t>{test_action(1, i), test_action(2, i), test_action(3, i)});
    ASSERT_EQ(shown(a, 0), shown(first, 0)) << i;
    for (int row = 1; row < 4; ++row) ASSERT_EQ(shown(a, row), shown(rest, row - 1)) << i;
    b.restore(1, a.snapshot(2));
    for (std::size_t sensor = 0; sensor < a.sensors().size(); ++sensor)
      ASSERT_EQ(row_of(a.rows(a.sensors()[sensor].name), 4, 2), row_of(b.rows(b.sensors()[sensor].name), 2, 1))
          << i << " " << a.sensors()[sensor].name;
  }
  EXPECT_GT(a.agent(2).episode_count, 0);
}

// The agent is in the middle, on walkable ground, and its path leads to it.
TEST_F(WayNoise, TheMapShowsTheAgentAndItsPath) {
  EnvConfig config = of_the_way();
  config.observation.topdown_map = true;
  config.observation.map = {.size_px = 33, .metres_per_px = 0.25f};
  BatchedEnv env(config, make_set({room_episode("shoebox:6x3x5@0.3", {1, 0, 1}, 0, {5, 0, 4}, "synth:noise")}), scenes_, 1);
  env.reset();
  const auto map = [&](int row, int column, int channel) {
    for (std::size_t sensor = 0; sensor < env.sensors().size(); ++sensor)
      if (env.sensors()[sensor].name == "topdown_map") {
        EXPECT_EQ(env.sensors()[sensor].shape, (std::vector<int>{33, 33, 3}));
        return std::to_integer<int>(env.rows(env.sensors()[sensor].name)[static_cast<std::size_t>((row * 33 + column) * 3 + channel)]);
      }
    return -1;
  };
  EXPECT_EQ(map(16, 16, 0), 255);
  EXPECT_EQ(map(16, 16, 2), 255);
  EXPECT_EQ(map(16, 8, 0), 0);  // two metres to its left is beyond the wall
  for (int turn = 0; turn < 9; ++turn) env.step(std::vector<std::int32_t>{3});
  for (int move = 0; move < 5; ++move) env.step(std::vector<std::int32_t>{1});
  // 0.75 m to the right of the start, which is behind it now: three pixels down.
  EXPECT_EQ(map(16, 16, 2), 255);
  EXPECT_EQ(map(19, 16, 1), 255);
  EXPECT_EQ(map(22, 16, 1), 0);
  EXPECT_EQ(map(13, 16, 1), 0);
}

TEST(WayNoiseConfig, RangesAreChecked) {
  const auto task = [](ActuationNoise noise, Motion motion = Motion::continuous) {
    TaskConfig config{.motion = motion};
    config.actuation_noise = noise;
    validate(config);
  };
  EXPECT_NO_THROW(task({.forward_m = 0.05f, .turn_deg = 5, .veer_deg = 5}));
  EXPECT_THROW(task({.forward_m = 0.06f}), InputError);
  EXPECT_THROW(task({.turn_deg = -1}), InputError);
  EXPECT_THROW(task({.veer_deg = NAN}), InputError);
  EXPECT_THROW(task({.veer_deg = 1}, Motion::grid), InputError);
  ObservationSpec spec;
  spec.pose_noise.position_m = 0.1f;
  EXPECT_THROW(validate(spec), InputError);  // no sensor that it concerns
  spec.pose = true;
  EXPECT_NO_THROW(validate(spec));
  spec.pose_noise.heading_deg = 181;
  EXPECT_THROW(validate(spec), InputError);
  ObservationSpec map;
  map.map.goal = true;
  EXPECT_THROW(validate(map), InputError);
  map.topdown_map = true;
  EXPECT_NO_THROW(validate(map));
}

}  // namespace
}  // namespace earshot
