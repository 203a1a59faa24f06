// SPDX-License-Identifier: Apache-2.0
// Episodes of several agents in one env: how they end, are saved, go wrong and are read.
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>

#include "envs/batch/quarantine_replay.h"
#include "sim/base/errors.h"
#include "tests/support/envs/agents_fixture.h"
#include "tests/support/envs/episode_refusal.h"

namespace earshot {
namespace {

TEST(Agents, WaitUntilAllHaveEnded) {
  for (const Autoreset mode : {Autoreset::same_step, Autoreset::next_step}) {
    EnvConfig config = two_agents();
    config.order = EpisodeOrder::random;
    config.autoreset = mode;
    config.observation.waveform = true;
    const auto scenes = make_scene_cache(config);
    BatchedEnv env(config, make_set({two_in_a_room({4, 0, 4}, "synth:bird")}), scenes, 1);
    env.reset();
    env.step(std::vector<std::int32_t>{kForward, kForward});
    EXPECT_TRUE(env.acted()[0] && env.acted()[1]);
    const auto depth_before = row_of(float_rows(env, "depth"), 2, 1);
    env.step(std::vector<std::int32_t>{kForward, kStop});
    EXPECT_TRUE(env.terminated()[1] && env.acted()[1] && !env.active()[1]);
    EXPECT_FALSE(env.terminated()[0] || !env.active()[0]);
    EXPECT_TRUE(env.finished().empty());
    EXPECT_EQ(row_of(float_rows(env, "depth"), 2, 1), std::vector<float>(16 * 16, 0.f));
    EXPECT_NE(row_of(final_float_rows(env, "depth"), 2, 1), std::vector<float>(16 * 16, 0.f));
    const auto last = row_of(final_float_rows(env, "depth"), 2, 1);
    const glm::vec3 stands = env.agent(1).pose.position;
    for (int step = 0; step < 4; ++step) {
      env.step(std::vector<std::int32_t>{kForward, 99});  // not used, and so not refused
      EXPECT_FALSE(env.terminated()[1] || env.acted()[1] || env.active()[1]);
      EXPECT_EQ(env.rewards()[1], 0.f);
      EXPECT_EQ(env.agent(1).pose.position, stands);
      EXPECT_EQ(row_of(final_float_rows(env, "depth"), 2, 1), last);
      EXPECT_GT(std::ranges::max(row_of(float_rows(env, "waveform"), 2, 0)), 0.f);
    }
    env.step(std::vector<std::int32_t>{kStop, kForward});
    EXPECT_TRUE(env.terminated()[0] && !env.terminated()[1]);
    ASSERT_EQ(env.finished().size(), 2u);
    EXPECT_EQ(env.finished()[0].agent, 0);
    EXPECT_EQ(env.finished()[1].agent, 1);
    EXPECT_EQ(env.finished()[0].metrics.steps, 7);
    EXPECT_EQ(env.finished()[1].metrics.steps, 2);
    EXPECT_EQ(env.finished()[1].actions, (std::vector<std::int8_t>{1, 0}));
    EXPECT_TRUE(env.active()[0] && env.active()[1]);
    if (mode == Autoreset::next_step) {
      EXPECT_EQ(env.agent(0).episode_step, 7);
      env.step(std::vector<std::int32_t>{99, 99});
      EXPECT_FALSE(env.acted()[0] || env.acted()[1]);
    }
    EXPECT_EQ(env.agent(0).episode_step, 0);
    EXPECT_NE(row_of(float_rows(env, "depth"), 2, 1), std::vector<float>(16 * 16, 0.f));
  }
}

TEST_F(SeveralAgents, SnapshotsGoOnWithTheSameBits) {
  for (const Autoreset mode : {Autoreset::same_step, Autoreset::next_step}) {
    EnvConfig config = config_;
    config.autoreset = mode;
    BatchedEnv a(config, set_, scenes_, 2), b(config, set_, scenes_, 3);
    a.reset();
    b.reset();
    int waiting = 0;
    for (int step = 0; step < 40; ++step) {
      a.step(actions_of(0, 2, kAgents, step));
      b.restore(2, a.snapshot(1));
      const auto compare = [&] {
        for (std::size_t sensor = 0; sensor < a.sensors().size(); ++sensor)
          for (int agent = 0; agent < kAgents; ++agent)
            ASSERT_EQ(row_of(a.rows(a.sensors()[sensor].name), 6, 3 + agent), row_of(b.rows(b.sensors()[sensor].name), 9, 6 + agent))
                << step << " " << agent << " " << a.sensors()[sensor].name;
      };
      compare();
      for (std::size_t agent = 0; agent < kAgents; ++agent) {
        ASSERT_EQ(a.active()[3 + agent], b.active()[6 + agent]);
        if (a.active()[3 + agent]) continue;
        ++waiting;  // its last observation is there as well
        for (std::size_t sensor = 0; sensor < a.sensors().size(); ++sensor)
          ASSERT_EQ(row_of(a.final_rows(a.sensors()[sensor].name), 6, 3 + static_cast<int>(agent)),
                    row_of(b.final_rows(b.sensors()[sensor].name), 9, 6 + static_cast<int>(agent)))
              << a.sensors()[sensor].name;
      }
      // And a step further.
      std::vector<std::int32_t> ahead = actions_of(0, 3, kAgents, step);
      const std::string before = a.snapshot(1);
      a.step(std::vector<std::int32_t>(ahead.begin(), ahead.begin() + 6));
      std::copy_n(ahead.begin() + 3, 3, ahead.begin() + 6);
      b.step(ahead);
      compare();
      a.restore(1, before);
    }
    EXPECT_GT(waiting, 5);
    const BatchedEnv& shown = a;
    EXPECT_EQ(shown.quarantine_counters().total(), 0u);
    EnvConfig two = config;
    two.agents = 2;
    BatchedEnv other(two, set_, scenes_, 1);
    other.reset();
    EXPECT_THROW(other.restore(0, a.snapshot(0)), InputError);
  }
}

TEST_F(SeveralAgents, AFaultOfOneEndsTheEpisodeOfAll) {
  const TestFolder folder("agents_fault");
  config_.quarantine_dir = folder.path().string();
  BatchedEnv env(config_, set_, scenes_, 2), plain(config_, set_, scenes_, 2);
  env.set_stage_hook([](const StageOutput& output, std::span<float> values) {
    if (output.kind == Fault::sound && output.env == 1 && output.agent == 1 && output.step == 4) values[7] = std::nanf("");
  });
  env.reset();
  plain.reset();
  for (int step = 0; step < 4; ++step) {
    std::vector<std::int32_t> actions = actions_of(0, 2, kAgents, step);
    for (std::size_t row = 3; row < 6; ++row) actions[row] = kForward;
    if (step == 1) actions[5] = kStop;
    env.step(actions);
    plain.step(actions);
    for (int row = 0; row < 3; ++row) ASSERT_EQ(shown_to_agent(env, row), shown_to_agent(plain, row)) << step;
  }
  EXPECT_EQ(env.quarantine_counters().of(Fault::sound), 1u);
  for (std::size_t row = 3; row < 6; ++row) {
    EXPECT_TRUE(env.truncated()[row] && env.quarantined()[row] && !env.terminated()[row]);
    EXPECT_EQ(env.rewards()[row], 0.f);
    EXPECT_TRUE(env.active()[row]);
    EXPECT_EQ(env.acted()[row], row < 5);
    EXPECT_EQ(row_of(final_float_rows(env, "depth"), 6, static_cast<int>(row)), std::vector<float>(16 * 16, 0.f));
  }
  const auto files = folder.files();
  ASSERT_EQ(files.size(), 1u);
  const QuarantineRecord record = load_quarantine_record(files[0]);
  ASSERT_EQ(record.others.size(), 2u);
  EXPECT_EQ(record.step, 4);
  EXPECT_EQ(record.others[1].size(), 2u);
  const ReplayOutcome again = replay(record, {}, [](const StageOutput& output, std::span<float> values) {
    if (output.kind == Fault::sound && output.agent == 1 && output.step == 4) values[7] = std::nanf("");
  });
  EXPECT_TRUE(again.recurs);
  const ReplayOutcome healed = replay(record);
  EXPECT_FALSE(healed.fault);
}

TEST(Agents, WhatIsMissingOrWrongIsSaid) {
  EnvConfig config = two_agents();
  const auto scenes = make_scene_cache(config);
  const Episode alone = room_episode(kRoom, {1, 0, 4}, 0, {7, 0, 1}, "synth:noise");
  try {
    BatchedEnv(config, make_set({alone}), scenes, 1);
    FAIL();
  } catch (const InputError& error) {
    EXPECT_THAT(error.what(), testing::HasSubstr("env.agents is 2"));
    EXPECT_THAT(error.what(), testing::HasSubstr("--agents"));
  }
  Episode off = two_in_a_room({40, 0, 4});
  off.episode_id = "off";
  BatchedEnv env(config, make_set({two_in_a_room({3, 0, 4}), off}), scenes, 2);
  env.reset();  // the second episode cannot begin
  EXPECT_EQ(env.quarantine_counters().of(Fault::path), 1u);
  EXPECT_TRUE(env.active()[0] && env.active()[1]);
  EXPECT_FALSE(env.active()[2] || env.active()[3]);
  config.agents = 17;
  EXPECT_THROW(validate(config), InputError);
  config.agents = 2;
  config.observation.renderer = Renderer::egl;
  EXPECT_THROW(validate(config), InputError);
}

TEST(EpisodeSet, AgentsAreReadAndWritten) {
  Episode episode = two_in_a_room({3, 0, 4});
  episode.other_agents.clear();
  EXPECT_EQ(episode_set_text({episode}).find("agent"), std::string::npos);
  episode.other_agents = {{.start_position = {3, 0, 4}, .start_rotation = {0, 1, 0, 0}, .sound = "synth:bird", .level_db = -6},
                          {.start_position = {5, 0, 4}}};
  episode.agent_sound = "synth:alarm";
  episode.agent_level_db = 3;
  const EpisodeSet read = parse_episode_set(episode_set_text({episode}), "set");
  EXPECT_EQ(read.episodes[0].other_agents, episode.other_agents);
  EXPECT_EQ(read.episodes[0].agent_sound, episode.agent_sound);
  EXPECT_EQ(read.episodes[0].agent_level_db, 3.f);
  EXPECT_EQ(episode_set_hash(read.episodes), episode_set_hash({episode}));
  const auto refusal = [&](const std::string& from, const std::string& to) { return refusal_of_changed(episode, from, to); };
  EXPECT_THAT(refusal("\"level_db\":-6.0", "\"level_db\":-600.0"), testing::HasSubstr("agents[0].level_db"));
  EXPECT_THAT(refusal("\"level_db\":-6.0", "\"loudness\":-6.0"), testing::HasSubstr("agents[0].loudness is not a key"));
  EXPECT_THAT(refusal("\"sound\":\"synth:bird\"", "\"sound\":\"\""), testing::HasSubstr("agents[0].sound is empty"));
  EXPECT_THAT(refusal("\"sound\":\"synth:bird\",", ""), testing::HasSubstr("has no effect without"));
  EXPECT_THAT(refusal("[0.0,1.0,0.0,0.0]", "[0.0,0.0,0.0,0.0]"), testing::HasSubstr("zero quaternion"));
  EXPECT_THAT(refusal("\"agent_sound\":\"synth:alarm\",", ""), testing::HasSubstr("agent_level_db"));
}

}  // namespace
}  // namespace earshot
