// SPDX-License-Identifier: Apache-2.0
#include "trainer/rollout/rollout_collector.h"

#include <gtest/gtest.h>

#include "policy/actor_critic.h"
#include "tests/support/envs/env_fixture.h"
#include "trainer/run/run_config.h"

namespace earshot {
namespace {

RunConfig run_config(bool overlap, int threads) {
  RunConfig config;
  config.env = quick_env_config();
  config.env.threads = threads;
  config.rollout_steps = 20;  // longer than an episode: ends and starts are among the rows
  config.overlap = overlap;
  config.policy.hidden_size = 16;
  config.policy.visual_features = config.policy.audio_features = 16;
  config.policy.conv_channels = 4;
  config.env.observation.camera.width_px = config.env.observation.camera.height_px = 48;
  config.guidance.imitation = 1;
  config.guidance.oracle = 0.5;
  config.guidance.oracle_until = 1;
  return config;
}

struct Collected {
  RolloutBuffer rollout;
  torch::Tensor hidden;
  EpisodeSums finished;
};

/// So many rollouts of five envs, all at `progress`; the last one.
Collected collect(const RunConfig& config, int rollouts = 2, double progress = 0.5) {
  torch::set_num_threads(1);
  static const auto set = quick_set(3);
  EnvConfig env_config = config.env;
  env_config.observation = training_sensors(config);
  BatchedEnv env(env_config, set, make_scene_cache(env_config), 5);
  env.reset();
  RolloutCollector collector(rollout_config(config), env, ActorCritic(config.env.observation, config.policy), 0);
  EpisodeSums finished;
  StageTimes times;
  for (int i = 0; i < rollouts; ++i) collector.collect(progress, finished, times);
  return {collector.rollout(), collector.hidden(), finished};
}

void expect_same(const Collected& a, const Collected& b) {
  for (std::size_t i = 0; i < a.rollout.observations.sensors.size(); ++i)
    EXPECT_TRUE(a.rollout.observations.sensors[i].rows.equal(b.rollout.observations.sensors[i].rows)) << i;
  for (torch::Tensor RolloutBuffer::*slab :
       {&RolloutBuffer::not_done, &RolloutBuffer::actions, &RolloutBuffer::log_prob, &RolloutBuffer::values, &RolloutBuffer::rewards,
        &RolloutBuffer::terminated, &RolloutBuffer::truncated, &RolloutBuffer::final_values, &RolloutBuffer::valid, &RolloutBuffer::guided,
        &RolloutBuffer::hidden, &RolloutBuffer::next_value})
    EXPECT_TRUE((a.rollout.*slab).equal(b.rollout.*slab));
  EXPECT_TRUE(a.hidden.equal(b.hidden));
  EXPECT_EQ(a.finished.values, b.finished.values);
}

TEST(RolloutCollector, HalvesInTheBackgroundGiveTheSameBitsEachTime) {
  const Collected one_thread = collect(run_config(true, 1));
  EXPECT_EQ(one_thread.rollout.num_steps(), 20);
  EXPECT_GT(one_thread.finished.values[EpisodeSums::count], 5);
  expect_same(one_thread, collect(run_config(true, 1)));
  expect_same(one_thread, collect(run_config(true, 3)));
}

// Products of two and three rows and of five differ in the last bit, and so do probabilities; what is done is the same.
TEST(RolloutCollector, HalvesDoWhatTheWholeBatchDoes) {
  const Collected halves = collect(run_config(true, 2)), whole = collect(run_config(false, 2));
  EXPECT_TRUE(halves.rollout.actions.equal(whole.rollout.actions));
  EXPECT_TRUE(halves.rollout.rewards.equal(whole.rollout.rewards));
  EXPECT_TRUE(halves.rollout.guided.equal(whole.rollout.guided));
  EXPECT_TRUE(halves.rollout.not_done.equal(whole.rollout.not_done));
  EXPECT_LT((halves.rollout.log_prob - whole.rollout.log_prob).abs().max().item<double>(), 1e-5);
  EXPECT_LT((halves.rollout.values - whole.rollout.values).abs().max().item<double>(), 1e-4);
  EXPECT_EQ(halves.finished.values, whole.finished.values);
}

// Eight steps, a rollout that ends after three, and eight more are the nineteen steps of one rollout: no row is read twice, and the policy
// goes on from what it saw last.
TEST(RolloutCollector, ARolloutThatEndsEarlyIsFollowedByTheNextStep) {
  torch::set_num_threads(1);
  for (const bool overlap : {false, true}) {
    const auto rollouts = [&](int rollout_steps, const std::vector<int>& lengths) {
      RunConfig config = run_config(overlap, 1);
      config.rollout_steps = rollout_steps;
      EnvConfig env_config = config.env;
      env_config.observation = training_sensors(config);
      BatchedEnv env(env_config, quick_set(3), make_scene_cache(env_config), 5);
      env.reset();
      RolloutCollector collector(rollout_config(config), env, ActorCritic(config.env.observation, config.policy), 0);
      std::map<std::string, std::vector<torch::Tensor>> rows;
      for (const int length : lengths) {
        EpisodeSums finished;
        StageTimes times;
        collector.collect(0.5, finished, times, [&](int step) { return step + 1 == length; });
        const RolloutBuffer& rollout = collector.rollout();
        EXPECT_EQ(rollout.num_steps(), length);
        const auto add = [&](const std::string& name, const torch::Tensor& slab) {
          rows[name].push_back(slab.slice(0, 0, rollout.num_steps()).clone());
        };
        for (const auto& [name, slab] : rollout.observations.sensors) add(name, slab);
        add("not_done", rollout.not_done), add("actions", rollout.actions), add("log_prob", rollout.log_prob);
        add("values", rollout.values), add("rewards", rollout.rewards), add("final_values", rollout.final_values);
        rows["next_value"] = {rollout.next_value.clone()};
      }
      return rows;
    };
    const auto cut = rollouts(8, {8, 3, 8}), whole = rollouts(19, {19});
    ASSERT_EQ(cut.size(), whole.size());
    for (const auto& [name, parts] : cut) EXPECT_TRUE(torch::cat(parts).equal(whole.at(name)[0])) << name << (overlap ? ", overlap" : "");
  }
}

// Where it always acts, no episode is the policy's.
TEST(RolloutCollector, EpisodesOfTheOracleAreNotCounted) {
  RunConfig config = run_config(false, 2);
  config.guidance.oracle = 1;
  config.guidance.imitation_end_weight = 1;
  config.guidance.oracle_until = 1;
  const auto counted = [&](double progress) { return collect(config, 1, progress).finished.values[EpisodeSums::count]; };
  EXPECT_EQ(counted(0), 0);
  EXPECT_GT(counted(1), 0);
}

TEST(RolloutCollector, TheOracleActsInSomeEpisodesFromTheirBeginning) {
  const Collected run = collect(run_config(false, 2));
  const torch::Tensor guided = run.rollout.guided;
  EXPECT_GT(guided.sum().item<double>(), 0);
  EXPECT_LT(guided.sum().item<double>(), guided.numel());
  const torch::Tensor oracle = run.rollout.observations["oracle_action"].squeeze(2).to(torch::kInt64);
  EXPECT_TRUE(run.rollout.actions.masked_select(guided.to(torch::kBool)).equal(oracle.masked_select(guided.to(torch::kBool))));
  for (std::int64_t t = 1; t < guided.size(0); ++t)
    for (std::int64_t env = 0; env < guided.size(1); ++env)
      if (run.rollout.not_done[t][env].item<float>() != 0) {
        EXPECT_EQ(guided[t][env].item<float>(), guided[t - 1][env].item<float>()) << t << " " << env;
      }
}

}  // namespace
}  // namespace earshot
