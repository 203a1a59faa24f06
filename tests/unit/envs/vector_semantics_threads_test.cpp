// How a batch is driven: which envs are reset, what follows an end, stepping in the background, and moving envs between batches.  Every
// claim is one about bits.
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <chrono>
#include <new>
#include <numbers>
#include <set>
#include <stdexcept>
#include <thread>

#include "envs/sensor_rows.h"
#include "sim/base/errors.h"
#include "sim/scene/appearance.h"
#include "sim/vision/embree_camera.h"
#include "tests/support/env_cases.h"
#include "tests/support/env_roll_out.h"

namespace earshot {
namespace {

using roll_outs::test_action;

/// All that a policy may read of an env.
std::vector<std::byte> shown(const BatchedEnv& env, int row) {
  std::vector<std::byte> all;
  const auto count = static_cast<std::size_t>(env.num_envs());
  for (std::size_t sensor = 0; sensor < env.sensors().size(); ++sensor)
    for (const auto rows : {env.rows(sensor), env.final_rows(sensor)})
      roll_outs::append_row(all, rows, static_cast<std::size_t>(row), count);
  const auto i = static_cast<std::size_t>(row);
  for (const std::uint8_t flag : {env.terminated()[i], env.truncated()[i], env.active()[i], env.collided()[i], env.quarantined()[i]})
    all.push_back(static_cast<std::byte>(flag));
  const float reward = env.rewards()[i];
  const auto bytes = std::as_bytes(std::span(&reward, 1));
  all.insert(all.end(), bytes.begin(), bytes.end());
  return all;
}

class VectorSemantics : public testing::Test {
 protected:
  static EnvConfig every_sensor() {
    EnvConfig config = quick_env_config();
    config.observation.waveform = config.observation.heard = config.observation.gps_compass = config.observation.pose = true;
    config.observation.collision = config.observation.previous_action = true;
    config.observation.rgb = config.observation.semantic = config.observation.depth_noise = true;
    config.observation.cameras = {
        {.name = "around",
         .config = {.width_px = 16, .height_px = 8, .projection = Projection::equirectangular, .horizontal_fov_deg = 360},
         .depth = true,
         .normals = true}};
    return config;
  }
  BatchedEnv make(int envs, const EnvConfig& config) { return BatchedEnv(config, set_, scenes_, envs); }
  void step(BatchedEnv& env, int index) {
    std::vector<std::int32_t> actions;
    for (int i = 0; i < env.num_envs(); ++i) actions.push_back(test_action(i, index));
    env.step(actions);
  }
  EnvConfig config_ = every_sensor();
  std::shared_ptr<const EpisodeSet> set_ = quick_set(2);
  std::shared_ptr<SceneCache> scenes_ = make_scene_cache(config_);
};

TEST_F(VectorSemantics, SensorsOfTheWaySayWhatTheAgentDid) {
  config_.order = EpisodeOrder::once;
  BatchedEnv env(config_, make_set({room_episode("shoebox:6x3x5@0.3", {1, 0, 1}, 0, {5, 0, 4}, "synth:noise")}), scenes_, 1);
  env.reset();
  const auto floats = [&](std::string_view name, bool final = false) {
    for (std::size_t sensor = 0; sensor < env.sensors().size(); ++sensor)
      if (env.sensors()[sensor].name == name) return as_floats(final ? env.final_rows(sensor) : env.rows(sensor));
    return std::span<const float>{};
  };
  const auto integer = [&](std::string_view name) {
    for (std::size_t sensor = 0; sensor < env.sensors().size(); ++sensor)
      if (env.sensors()[sensor].name == name) {
        std::int32_t value = 0;
        std::ranges::copy(env.rows(sensor), std::as_writable_bytes(std::span(&value, 1)).begin());
        return value;
      }
    return -99;
  };
  EXPECT_THAT(floats("gps_compass"), testing::ElementsAre(0.f, 0.f, 0.f));
  EXPECT_EQ(integer("previous_action"), -1);
  for (int turn = 0; turn < 9; ++turn) env.step(std::vector<std::int32_t>{3});  // right by 90 degrees
  for (int move = 0; move < 4; ++move) env.step(std::vector<std::int32_t>{1});
  EXPECT_EQ(integer("previous_action"), 1);
  EXPECT_NEAR(floats("gps_compass")[0], 0, 1e-5);
  EXPECT_NEAR(floats("gps_compass")[1], 0.6, 1e-5);
  EXPECT_NEAR(floats("gps_compass")[2], -std::numbers::pi / 2, 1e-6);
  EXPECT_NEAR(floats("pose")[3], 13 * 0.15, 1e-6);
  EXPECT_EQ(floats("waveform").size(), 2u * 2400u);
  EXPECT_TRUE(std::ranges::equal(floats("waveform").subspan(0, 2400), floats("heard").subspan(16000 - 2400, 2400)));
}

TEST_F(VectorSemantics, CamerasSeeFromWhereTheAgentStands) {
  config_.observation.depth_noise = false;
  BatchedEnv env = make(2, config_);
  env.reset();
  for (int i = 0; i < 5; ++i) step(env, i);
  const std::vector<ExtraCamera> cameras = config_.observation.all_cameras();
  ASSERT_EQ(cameras.size(), 2u);
  for (int row = 0; row < 2; ++row) {
    const Scene& scene = *env.source(row).scene->scene;
    const auto appearance = load_appearance(scene);
    std::vector<std::uint8_t> rgb(16 * 16 * 3);
    std::vector<std::uint16_t> semantic(16 * 16);
    std::vector<float> normals(16 * 8 * 3);
    EmbreeCamera(cameras[0].config).render(scene, appearance.get(), env.pose(row), {.rgb = rgb, .semantic = semantic});
    EmbreeCamera(cameras[1].config).render(scene, nullptr, env.pose(row), {.normals = normals});
    const auto check = [&](std::string_view name, std::span<const std::byte> expected) {
      for (std::size_t sensor = 0; sensor < env.sensors().size(); ++sensor) {
        if (env.sensors()[sensor].name != name) continue;
        EXPECT_TRUE(std::ranges::equal(row_of(env.rows(sensor), 2, row), expected)) << name;
      }
    };
    check("rgb", std::as_bytes(std::span(rgb)));
    check("semantic", std::as_bytes(std::span(semantic)));
    check("around_normals", std::as_bytes(std::span(normals)));
    EXPECT_GT(*std::ranges::max_element(rgb), 40);
  }
}

// Bits of the sequence of an env with a seed of its own do not depend on where it runs, and are reached again.
TEST_F(VectorSemantics, ASeedOfItsOwnGivesTheSameEpisodesInAnyEnv) {
  BatchedEnv a = make(3, config_), b = make(5, config_);
  a.reset();
  b.reset();
  for (int i = 0; i < 7; ++i) step(b, i);
  a.reset(std::vector<std::uint8_t>{0, 1, 1}, std::vector<std::uint64_t>{0, 7, 8});
  b.reset(std::vector<std::uint8_t>{0, 0, 0, 0, 1}, std::vector<std::uint64_t>{0, 0, 0, 0, 7});
  EXPECT_EQ(shown(a, 1), shown(b, 4));
  EXPECT_NE(shown(a, 2), shown(b, 4));
  for (int i = 0; i < 40; ++i) {  // over ends of episodes
    std::vector<std::int32_t> actions_a(3, 1), actions_b(5, 2);
    actions_a[1] = actions_b[4] = test_action(9, i);
    a.step(actions_a);
    b.step(actions_b);
    ASSERT_EQ(shown(a, 1), shown(b, 4)) << i;
  }
  EXPECT_GT(a.episode_count(1), 0);
}

TEST_F(VectorSemantics, AMaskLeavesTheOthersAsTheyAre) {
  BatchedEnv env = make(4, config_), plain = make(4, config_);
  for (BatchedEnv* each : {&env, &plain}) {
    each->reset();
    for (int i = 0; i < 5; ++i) step(*each, i);
  }
  const std::vector<int> counts{env.episode_count(0), env.episode_count(2)};
  env.reset(std::vector<std::uint8_t>{1, 0, 1, 0});
  for (const int row : {1, 3}) EXPECT_EQ(shown(env, row), shown(plain, row));
  EXPECT_EQ(env.episode_count(0), counts[0] + 1);
  EXPECT_EQ(env.episode_count(2), counts[1] + 1);
  EXPECT_EQ(env.episode_step(0), 0);
  for (int i = 5; i < 12; ++i) {
    step(env, i);
    step(plain, i);
    for (const int row : {1, 3}) ASSERT_EQ(shown(env, row), shown(plain, row)) << i;
  }
}

// The three modes show the same episodes: what differs is when the next one begins.
TEST_F(VectorSemantics, AutoresetModesShowTheSameEpisodes) {
  EnvConfig next_step = config_, off = config_;
  next_step.autoreset = Autoreset::next_step;
  off.autoreset = Autoreset::off;
  BatchedEnv a = make(1, config_), b = make(1, next_step), c = make(1, off);
  for (BatchedEnv* env : {&a, &b, &c}) env->reset();
  const auto now = [](const BatchedEnv& env) {
    std::vector<std::byte> all;
    for (std::size_t sensor = 0; sensor < env.sensors().size(); ++sensor) roll_outs::append_row(all, env.rows(sensor), 0, 1);
    return all;
  };
  int ends = 0;
  for (int i = 0; i < 60; ++i) {
    const std::vector<std::int32_t> action{test_action(0, i)};
    for (BatchedEnv* env : {&a, &b, &c}) env->step(action);
    ASSERT_EQ(a.rewards()[0], b.rewards()[0]);
    ASSERT_EQ(a.terminated()[0], c.terminated()[0]);
    ASSERT_EQ(a.truncated()[0], b.truncated()[0]);
    if (a.terminated()[0] || a.truncated()[0]) {
      ++ends;
      EXPECT_EQ(now(b), now(c));  // the last of the episode
      for (std::size_t sensor = 0; sensor < a.sensors().size(); ++sensor) {
        EXPECT_TRUE(std::ranges::equal(a.final_rows(sensor), b.rows(sensor))) << a.sensors()[sensor].name;
        EXPECT_TRUE(std::ranges::equal(c.final_rows(sensor), c.rows(sensor)));
      }
      ASSERT_EQ(b.finished().size(), 1u);
      EXPECT_EQ(a.finished()[0].actions, b.finished()[0].actions);
      EXPECT_THROW(c.step(action), std::logic_error);
      c.reset(std::vector<std::uint8_t>{1});
      b.step(std::vector<std::int32_t>{99});  // not used, and so not refused
      EXPECT_EQ(b.rewards()[0], 0.f);
      EXPECT_FALSE(b.terminated()[0] || b.truncated()[0]);
    }
    ASSERT_EQ(now(a), now(b)) << i;
    ASSERT_EQ(now(a), now(c)) << i;
  }
  EXPECT_GT(ends, 3);
}

TEST_F(VectorSemantics, ASnapshotGoesOnInAnotherEnvOfAnotherBatch) {
  for (const Autoreset mode : {Autoreset::same_step, Autoreset::next_step, Autoreset::off}) {
    EnvConfig config = config_;
    config.autoreset = mode;
    BatchedEnv a = make(3, config), b = make(2, config);
    a.reset();
    b.reset();
    for (int i = 0; i < 20; ++i) {
      if (mode == Autoreset::off)
        for (int row = 0; row < 3; ++row)
          if (a.terminated()[static_cast<std::size_t>(row)] || a.truncated()[static_cast<std::size_t>(row)]) {
            std::vector<std::uint8_t> mask(3, 0);
            mask[static_cast<std::size_t>(row)] = 1;
            a.reset(mask);
          }
      step(a, i);
      b.restore(1, a.snapshot(2));
      for (std::size_t sensor = 0; sensor < a.sensors().size(); ++sensor)
        ASSERT_EQ(row_of(a.rows(sensor), 3, 2), row_of(b.rows(sensor), 2, 1)) << i << " " << a.sensors()[sensor].name;
      ASSERT_EQ(a.episode_count(2), b.episode_count(1));
    }
    if (mode == Autoreset::off) continue;
    for (int i = 20; i < 40; ++i) {
      a.step(std::vector<std::int32_t>{1, 1, test_action(5, i)});
      b.step(std::vector<std::int32_t>{2, test_action(5, i)});
      for (std::size_t sensor = 0; sensor < a.sensors().size(); ++sensor)
        ASSERT_EQ(row_of(a.rows(sensor), 3, 2), row_of(b.rows(sensor), 2, 1)) << i << " " << a.sensors()[sensor].name;
    }
    EXPECT_THROW(a.restore(0, "{}"), InputError);
    EXPECT_THROW(a.restore(0, a.save_state()), InputError);
  }
}

// Each env shows the same, whatever the threads, and however sending and waiting are interleaved.
TEST_F(VectorSemantics, SendingGivesTheBitsOfLockstep) {
  constexpr int kEnvs = 6, kSteps = 24;
  BatchedEnv lockstep = make(kEnvs, config_);
  lockstep.reset();
  std::vector<std::vector<std::vector<std::byte>>> expected(kEnvs);
  for (int i = 0; i < kSteps; ++i) {
    step(lockstep, i);
    for (int row = 0; row < kEnvs; ++row) expected[static_cast<std::size_t>(row)].push_back(shown(lockstep, row));
  }
  for (const int threads : {1, 2, 3, 8})
    for (const RecvOrder order : {RecvOrder::as_ready, RecvOrder::as_sent}) {
      EnvConfig config = config_;
      config.threads = threads;
      BatchedEnv env = make(kEnvs, config);
      env.reset();
      std::vector<int> done(kEnvs, 0);
      std::vector<std::int32_t> ready{0, 1, 2, 3, 4, 5};
      std::size_t ends = 0, under_way = 0;
      std::vector<std::vector<std::int32_t>> handed_back;
      while (!ready.empty() || under_way > 0) {
        std::vector<std::int32_t> send, actions;
        for (const std::int32_t row : ready)
          if (done[static_cast<std::size_t>(row)] < kSteps) {
            send.push_back(row);
            actions.push_back(test_action(row, done[static_cast<std::size_t>(row)]));
          }
        env.send(send, actions);
        under_way += send.size();
        ready.clear();
        if (under_way == 0) break;
        const auto got = env.recv(std::min(2, static_cast<int>(under_way)), order);
        ready.assign(got.begin(), got.end());
        handed_back.push_back(ready);
        under_way -= got.size();
        ends += env.finished().size();
        for (const std::int32_t row : ready) {
          const auto i = static_cast<std::size_t>(row);
          ASSERT_EQ(shown(env, row), expected[i][static_cast<std::size_t>(done[i]++)]) << row;
        }
      }
      EXPECT_GT(ends, 4u);
      if (order == RecvOrder::as_ready) continue;
      // Two at a time in the order of sending: 0 1, 2 3, 4 5, 0 1, ...
      for (std::size_t i = 0; i < handed_back.size(); ++i) EXPECT_EQ(handed_back[i].front(), static_cast<std::int32_t>(2 * (i % 3))) << i;
    }
}

TEST_F(VectorSemantics, WhatACallerCanGetWrongMovesNothing) {
  BatchedEnv env = make(3, config_);
  const std::vector<std::int32_t> one{1}, two{1, 1}, three{1, 1, 1};
  EXPECT_THROW(env.send(one, one), std::logic_error);  // before the first reset
  EXPECT_THROW(env.reset(std::vector<std::uint8_t>{1, 0, 1}), std::logic_error);
  env.reset();
  EXPECT_THROW(env.reset(std::vector<std::uint8_t>{1}), std::invalid_argument);
  EXPECT_THROW(env.reset(std::vector<std::uint8_t>{1, 1, 1}, std::vector<std::uint64_t>{1}), std::invalid_argument);
  EXPECT_THROW(env.recv(1), std::invalid_argument);  // none under way
  EXPECT_THROW(env.send(two, one), std::invalid_argument);
  EXPECT_THROW(env.send(two, two), std::logic_error);  // the same env twice
  EXPECT_THROW(env.send(std::vector<std::int32_t>{3}, one), std::out_of_range);
  EXPECT_THROW(env.send(std::vector<std::int32_t>{0, 1}, std::vector<std::int32_t>{1, 4}), std::invalid_argument);
  for (int row = 0; row < 3; ++row) EXPECT_EQ(env.episode_step(row), 0);
  env.send(one, one);
  EXPECT_THROW(env.step(three), std::logic_error);
  EXPECT_THROW(env.reset(), std::logic_error);
  EXPECT_THROW(static_cast<void>(env.save_state()), std::logic_error);
  EXPECT_THROW(static_cast<void>(env.snapshot(1)), std::logic_error);
  EXPECT_THROW(env.send(one, one), std::logic_error);
  EXPECT_THAT(env.recv(1), testing::ElementsAre(1));
  env.step(three);
  EXPECT_EQ(env.episode_step(1), 2);
  EXPECT_EQ(env.episode_step(0), 1);
}

// Sizes at and around powers of two, which rings of environments could get wrong.
TEST_F(VectorSemantics, BatchesOfAnySizeShowTheSameEnvs) {
  EnvConfig config = quick_env_config();
  config.observation.spectrogram = config.observation.depth = false;
  config.observation.collision = config.observation.gps_compass = true;
  BatchedEnv largest = make(1024, config);
  largest.reset();
  std::vector<std::vector<std::byte>> expected;
  for (int i = 0; i < 20; ++i) step(largest, i);
  for (int row = 0; row < 1024; ++row) expected.push_back(shown(largest, row));
  config.threads = 3;
  for (const int envs : {1, 2, 255, 256, 257, 1024}) {
    BatchedEnv env = make(envs, config);
    env.reset();
    std::vector<std::int32_t> all(static_cast<std::size_t>(envs)), actions(all.size());
    for (int i = 0; i < 20; ++i) {
      for (int row = 0; row < envs; ++row) {
        all[static_cast<std::size_t>(row)] = row;
        actions[static_cast<std::size_t>(row)] = test_action(row, i);
      }
      if (i % 2 == 0) {
        env.step(actions);
        continue;
      }
      env.send(all, actions);
      std::set<std::int32_t> got;
      while (got.size() < all.size()) {
        const auto some = env.recv(std::max(1, static_cast<int>(all.size() - got.size()) / 2));
        got.insert(some.begin(), some.end());
      }
    }
    for (int row = 0; row < envs; ++row) ASSERT_EQ(shown(env, row), expected[static_cast<std::size_t>(row)]) << envs << " " << row;
  }
}

/// Throws, or waits, in one stage of one env, once.
struct ThrowOnce {
  std::atomic<int> armed{0};  // 1: runtime_error, 2: bad_alloc, 3: no exception class at all, 4: logic_error
  Fault kind = Fault::pose;
  void operator()(const StageOutput& output) {
    if (output.kind != kind || output.env != 1) return;
    switch (armed.exchange(0)) {
      case 1:
        throw std::runtime_error("the roof fell in");
      case 2:
        throw std::bad_alloc();
      case 3:
        throw 7;
      case 4:
        throw std::logic_error("a bug");
      default:
        break;
    }
  }
};

// Any exception in any stage, reset included, ends one env's episode; the other envs show what they show without it.
TEST_F(VectorSemantics, AnyExceptionIsContainedInItsEnv) {
  config_.threads = 2;
  BatchedEnv plain = make(3, config_);
  BatchedEnv env = make(3, config_);
  ThrowOnce thrower;
  env.set_stage_hook([&](const StageOutput& output, std::span<float>) { thrower(output); });
  plain.reset();
  env.reset();
  std::uint64_t faults = 0;
  int index = 0;
  for (const Fault kind : {Fault::pose, Fault::distance, Fault::rir, Fault::sound, Fault::depth, Fault::spectrogram})
    for (const int what : {1, 2, 3, 4}) {
      thrower.kind = kind;
      thrower.armed = what;
      for (int tries = 0; thrower.armed != 0 && tries < 100; ++tries, ++index) {
        std::vector<std::int32_t> actions{test_action(0, index), 1, test_action(2, index)};
        if (tries > 0) actions[1] = test_action(1, index);  // stages without news are skipped: turn, or begin another episode
        plain.step(actions);
        env.step(actions);
        for (const int row : {0, 2}) ASSERT_EQ(shown(env, row), shown(plain, row)) << index;
      }
      ASSERT_EQ(thrower.armed, 0) << static_cast<int>(kind);
      ++faults;
      EXPECT_EQ(env.quarantine_counters().total(), faults);
    }
}

// A stage that does not come back is given up after the limit; its env is idle until it does, and the others go on with their bits.
TEST_F(VectorSemantics, AStalledStageLeavesTheBatchUntilItReturns) {
  config_.threads = 2;
  BatchedEnv plain = make(3, config_);
  // Far longer than any stage takes on this machine, in this build: the first reset loads the scenes too.
  const auto start = std::chrono::steady_clock::now();
  plain.reset();
  config_.stage_limit_s = std::max(0.5, 4 * std::chrono::duration<double>(std::chrono::steady_clock::now() - start).count());
  BatchedEnv env = make(3, config_);
  std::atomic<bool> armed{false}, released{false}, stuck{false};
  env.set_stage_hook([&](const StageOutput& output, std::span<float>) {
    if (output.env != 1 || output.kind != Fault::pose || !armed.exchange(false)) return;
    stuck = true;
    while (!released) std::this_thread::sleep_for(std::chrono::milliseconds(1));
    stuck = false;
  });
  env.reset();
  int index = 0;
  const auto both = [&] {
    const std::vector<std::int32_t> actions{test_action(0, index), 1, test_action(2, index)};
    plain.step(actions);
    env.step(actions);
    ++index;
    for (const int row : {0, 2}) ASSERT_EQ(shown(env, row), shown(plain, row)) << index;
  };
  for (int i = 0; i < 3; ++i) both();
  armed = true;
  both();
  EXPECT_TRUE(stuck);
  EXPECT_EQ(env.quarantine_counters().of(Fault::stall), 1u);
  EXPECT_TRUE(env.truncated()[1] && env.quarantined()[1] && !env.active()[1]);
  for (const float value : row_of(env.depth(), 3, 1)) ASSERT_EQ(value, 0.f);
  for (int i = 0; i < 5; ++i) both();
  EXPECT_FALSE(env.active()[1]);
  released = true;
  for (int tries = 0; tries < 2000 && !env.active()[1]; ++tries) {
    both();
    std::this_thread::sleep_for(std::chrono::milliseconds(1));
  }
  EXPECT_TRUE(env.active()[1]);
  for (int i = 0; i < 5; ++i) both();
  EXPECT_TRUE(buffers_are_finite(env));
  EXPECT_EQ(env.quarantine_counters().total(), 1u);
}

}  // namespace
}  // namespace earshot
