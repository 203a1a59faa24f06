// SPDX-License-Identifier: Apache-2.0
// Policies and training by the public functions: the bits of the engine, and what is refused.
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <algorithm>

#include "earshot/policy.h"
#include "earshot/train.h"
#include "envs/batch/batched_env.h"
#include "envs/config/batch_config.h"
#include "evaluation/results/evaluator.h"
#include "policy/action_distribution.h"
#include "policy/actor_critic.h"
#include "tests/support/files/test_files.h"
#include "trainer/checkpoint/checkpoint.h"
#include "trainer/collective/collective.h"
#include "trainer/rollout/actor.h"
#include "trainer/run/train_loop.h"

namespace earshot {
namespace {

using testing::HasSubstr;

std::string run_yaml(const std::string& folder) {
  const auto data = [&](const std::string& name, int count) {
    return "  " + name + ": {file: " + folder + "/" + name + ".json.gz, scenes: ['shoebox:6x3x5@0.3'], sounds: ['synth:noise'], " +
           "episodes_per_scene: " + std::to_string(count) + ", filter: {min_geodesic_m: 1, min_ratio: 1}}\n";
  };
  return "name: tiny\nseed: 3\nenvs_per_worker: 2\nrollout_steps: 8\ntotal_steps: 48\neval_envs: 2\nout: " + folder +
         "/run\nenv:\n  task: {max_steps: 10}\n  observation: {depth: false}\n"
         "  acoustics: {rays: 4, rir_length_s: 0.1, early_order: 0, field: off}\n"
         "policy: {hidden_size: 8, audio_features: 8, conv_channels: 2}\ndata:\n" +
         data("train", 6) + data("eval", 4);
}

TEST(ApiTraining, ARunHasTheWeightsOfTheEngineAndItsEvaluationTheNumbers) {
  const TempFolder folder, other;
  const auto run = api::Config::from_text(run_yaml(folder / "."));
  EXPECT_EQ(api::write_episode_sets(run), (std::pair<std::size_t, std::size_t>{6, 4}));
  EXPECT_THAT(api::run_config_text(run), HasSubstr("rollout_steps: 8"));
  const api::TrainReport report = api::train(run);
  EXPECT_EQ(report.env_steps, 48u);
  EXPECT_EQ(report.updates, 3u);

  RunConfig config = parse_run_config(run_yaml(folder / "."), "text", {"out=" + (other / "run")});
  const auto worker = make_single_worker();
  const TrainReport expected = train(config, *worker);
  EXPECT_EQ(hash_of(load_checkpoint(report.checkpoint).weights), hash_of(load_checkpoint(expected.checkpoint).weights));

  EXPECT_THAT(message_of<InputError>([&] { (void)api::train(run); }), HasSubstr("run"));  // the folder holds a run
  EXPECT_EQ(api::train(run, {.overwrite = true}).updates, 3u);
  EXPECT_EQ(api::train(api::Config::from_text(run_yaml(folder / "."), {{"total_steps", 80}}), {.resume = folder / "run"}).env_steps, 80u);

  const auto estimates =
      api::evaluate(expected.checkpoint, {.episodes = folder / "eval.json.gz", .seed = 4, .out = folder / "result.json"});
  EvaluationConfig evaluation;
  evaluation.episodes = folder / "eval.json.gz";
  evaluation.num_envs = 2;
  evaluation.seed = 4;
  const EvaluationResult result = evaluate_checkpoint(expected.checkpoint, evaluation, {});
  ASSERT_EQ(estimates.size(), result.summary().size());
  for (std::size_t i = 0; i < estimates.size(); ++i) {
    EXPECT_EQ(estimates[i].metric, result.summary()[i].first);
    EXPECT_EQ(estimates[i].mean, result.summary()[i].second.mean);
  }
  EXPECT_EQ(load_result(folder / "result.json").episodes.size(), 4u);
  const auto oracle = api::evaluate_baseline("oracle", run);
  EXPECT_EQ(oracle.front().metric, "success");
  EXPECT_GE(oracle.front().mean, 0.);
}

TEST(ApiTraining, AnAgentActsAsTheEnginesActor) {
  const TempFolder folder;
  const std::string yaml = run_yaml(folder / ".");
  const auto run = api::Config::from_text(yaml);
  (void)api::write_episode_sets(run);
  const api::Policy untrained = api::Policy::untrained(run);
  untrained.save(folder / "first.policy");
  const api::Policy policy = api::Policy::load(folder / "first.policy");
  EXPECT_EQ(policy.hash(), untrained.hash());
  EXPECT_GT(policy.num_parameters(), 100);
  EXPECT_THAT(policy.description(), HasSubstr("tiny"));

  const BatchParts parts = read_batch(yaml, "text", {}, {}, "train");
  const RunConfig config = parse_run_config(yaml, "text", {});
  for (const bool sample : {false, true}) {
    api::VectorEnv envs(api::Config::from_text(policy.config_text()), 3);
    api::Agent agent(policy, envs, {.sample = sample, .seed = 6});
    BatchedEnv engine(parts.config, parts.set, parts.scenes, 3);
    ActorCritic network(config.env.observation, config.policy);
    network->eval();
    Actor actor(network, 0, 3);
    envs.reset();
    engine.reset();
    std::vector<std::int32_t> expected(3);
    for (int step = 0; step < 15; ++step) {
      const PolicyOutput& output = actor.observe(engine);
      std::vector<ActingEnv> acting;
      for (int row = 0; row < 3; ++row)
        acting.push_back(
            {static_cast<std::uint32_t>(engine.agent(row).episode_index), 0, static_cast<std::uint32_t>(engine.agent(row).episode_step)});
      if (sample)
        sample_actions(output.logits, acting, 6, expected);
      else
        greedy_actions(output.logits, expected);
      const auto actions = agent.act();
      ASSERT_TRUE(std::ranges::equal(actions, expected)) << "step " << step << ", sampled " << sample;
      envs.step(actions);
      engine.step(expected);
      agent.observe_step();
      actor.advance(engine);
    }
  }
}

TEST(ApiTraining, WrongInputIsRefused) {
  const TempFolder folder;
  const auto run = api::Config::from_text(run_yaml(folder / "."));
  EXPECT_THAT(message_of<InputError>([&] { (void)api::train(run); }), HasSubstr("no such episode set"));
  EXPECT_THAT(message_of<InputError>([&] { (void)api::Policy::load(folder / "none.policy"); }), HasSubstr("none.policy"));
  EXPECT_THAT(message_of<InputError>([&] { (void)api::run_config_text(api::Config::from_text("seeed: 1")); }), HasSubstr("seed"));
  EXPECT_THAT(message_of<InputError>([&] { (void)api::evaluate_baseline("genius", run); }), HasSubstr("genius"));
  // Of another shape than the policy was made for.
  const api::Policy policy = api::Policy::untrained(run);
  (void)api::write_episode_sets(run);
  const api::VectorEnv envs(api::Config::from_text(policy.config_text()), 1, {.settings = {{"observation.collision", true}}});
  EXPECT_THAT(message_of<InputError>([&] { api::Agent(policy, envs); }), HasSubstr("collision"));
}

}  // namespace
}  // namespace earshot
