// SPDX-License-Identifier: Apache-2.0
#include "trainer/run/run_config.h"

#include <fmt/format.h>
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "sim/base/errors.h"
#include "tests/support/files/test_paths.h"
#include "trainer/run/effective_config.h"
#include "trainer/run/episode_data.h"

namespace earshot {
namespace {

using testing::ElementsAre;
using testing::HasSubstr;

std::string message_of(const std::string& yaml, const std::vector<std::string>& overrides = {}) {
  try {
    parse_run_config(yaml, "run.yaml", overrides);
  } catch (const InputError& error) {
    return error.what();
  }
  return "accepted";
}

TEST(ExpandRange, CountsUpAndLeavesOtherTextAlone) {
  EXPECT_THAT(expand_range("house:9..11,rooms=3"), ElementsAre("house:9,rooms=3", "house:10,rooms=3", "house:11,rooms=3"));
  EXPECT_THAT(expand_range("../shared/a..b.glb"), ElementsAre("../shared/a..b.glb"));
  EXPECT_THAT(expand_range("synth:bird:5..5"), ElementsAre("synth:bird:5"));
  EXPECT_THROW(expand_range("house:5..4"), InputError);
  EXPECT_THROW(expand_range("house:0..100000000"), InputError);
}

TEST(RunConfig, EverySectionRefusesUnknownKeys) {
  EXPECT_THAT(message_of("ppo: {learning_rat: 1}"), HasSubstr("ppo.learning_rat: unknown key; did you mean 'learning_rate'"));
  EXPECT_THAT(message_of("env: {task: {max_step: 1}}"), HasSubstr("did you mean 'max_steps'"));
  EXPECT_THAT(message_of("env: {acoustics: {ray: 1}}"), HasSubstr("did you mean 'rays'"));
  EXPECT_THAT(message_of("policy: {hidden: 1}"), HasSubstr("policy.hidden"));
  EXPECT_THAT(message_of("worker: 2"), HasSubstr("did you mean 'workers'"));
  EXPECT_THAT(message_of("data: {train: {seeds: 2}}"), HasSubstr("did you mean 'seed'"));
}

TEST(RunConfig, GuidanceThatWouldHaveNoEffectIsRefused) {
  EXPECT_EQ(message_of("policy: {goal_heads: true}\nguidance: {imitation: 1, oracle: 0.5, goal: 0.2}"), "accepted");
  EXPECT_THAT(message_of("guidance: {goal: 0.2}"), HasSubstr("policy.goal_heads"));
  EXPECT_THAT(message_of("policy: {goal_heads: true}"), HasSubstr("guidance.goal"));
  EXPECT_THAT(message_of("guidance: {oracle: 0.5}"), HasSubstr("guidance.oracle"));
  EXPECT_THAT(message_of("guidance: {imitation: 1, imitation_until: 0}"), HasSubstr("imitation_until"));
  EXPECT_THAT(message_of("guidance: {imitation: 1, imitation_until: 0.1, oracle: 1, oracle_until: 0.5}"), HasSubstr("oracle_until"));
  EXPECT_EQ(message_of("guidance: {imitation: 1, imitation_until: 0.1, imitation_end_weight: 0.1, oracle: 1, oracle_until: 0.5}"),
            "accepted");
  EXPECT_THAT(message_of("guidance: {imitaton: 1}"), HasSubstr("did you mean 'imitation'"));
  EXPECT_THAT(message_of("schedule: minutes"), HasSubstr("max_minutes"));
  EXPECT_THAT(message_of("schedule: hours"), HasSubstr("minutes"));
  EXPECT_THAT(message_of("eval_actions: best"), HasSubstr("argmax"));
  EXPECT_THAT(message_of("overlap: true\nenvs_per_worker: 1"), HasSubstr("overlap"));
}

TEST(RunConfig, SensorsOfTheLossesAreThoseOfTrainingAlone) {
  const RunConfig config = parse_run_config("policy: {goal_heads: true}\nguidance: {imitation: 1, goal: 0.2}", "run.yaml", {});
  EXPECT_TRUE(training_sensors(config).oracle_action && training_sensors(config).goal_state);
  EXPECT_FALSE(config.env.observation.oracle_action || config.env.observation.goal_state);
  const RunConfig plain = parse_run_config("", "run.yaml", {});
  EXPECT_FALSE(training_sensors(plain).oracle_action || training_sensors(plain).goal_state);
}

TEST(RunConfig, ValuesOutOfRangeNameKeyAndRule) {
  EXPECT_THAT(message_of("workers: 0"), HasSubstr("run.yaml:1: workers is 0; use a whole number from 1 to 1,024"));
  EXPECT_THAT(message_of("workers: 65\nnetwork: {on_loss: continue}"),
              HasSubstr("network.on_loss = continue: must be stop with 65 workers"));
  EXPECT_THAT(message_of("rollout_steps: -1"), HasSubstr("rollout_steps"));
  EXPECT_THAT(message_of("seed: many"), HasSubstr("seed is many; use a whole number from 0 to 2^64 - 1"));
  EXPECT_THAT(message_of("ppo: {clip: -0.1}"), HasSubstr("clip"));
  EXPECT_THAT(message_of("ppo: {preempt_fraction: 1}"), HasSubstr("ppo.preempt_fraction is 1; use a number of at least 0 and below 1"));
  EXPECT_THAT(message_of("ppo: {preempt_least: 0.5}"), HasSubstr("ppo.preempt_least = 0.5: has no effect without ppo.preempt_fraction"));
  EXPECT_THAT(message_of("ppo: {preempt_fraction: 0.6, preempt_least: 1.5}"),
              HasSubstr("ppo.preempt_least is 1.5; use a number from 0 to 1"));
  EXPECT_THAT(message_of("ppo: {preempt_fraction: 0.6, preempt_weight: ranks}"), HasSubstr("preempt_weight"));
  EXPECT_THAT(message_of("ppo: {preempt_weight: truncated}"), HasSubstr("has no effect without ppo.preempt_fraction"));
  const RunConfig config = parse_run_config("ppo: {preempt_fraction: 0.6, preempt_weight: worker}", "run.yaml", {});
  EXPECT_EQ(parse_run_config(config_text(config), "run.yaml", {}).ppo.preempt_weight, PreemptWeight::worker);
}

TEST(RunConfig, EvaluationsNeedASetAndPatienceNeedsEvaluations) {
  const std::string set = "data: {held_out: {file: a.json, scenes: [\"shoebox:5x3x4\"]}}\n";
  EXPECT_FALSE(parse_run_config(set, "run.yaml", {}).held_out.is_on()) << "the set alone does nothing";
  const RunConfig config = parse_run_config(set + "held_out: {every_updates: 5, patience: 3}", "run.yaml", {});
  EXPECT_TRUE(config.held_out.is_on());
  EXPECT_EQ(config.held_out.max_fraction, 0.1);
  EXPECT_EQ(parse_run_config(config_text(config), "run.yaml", {}).held_out.patience, 3);
  EXPECT_EQ(parse_run_config(config_text(config), "run.yaml", {}).held_out_data.scenes, config.held_out_data.scenes);
  EXPECT_THAT(message_of("held_out: {every_updates: 5}"), HasSubstr("held_out.every_updates = 5: needs data.held_out with a file"));
  EXPECT_THAT(message_of(set + "held_out: {patience: 3}"), HasSubstr("held_out.patience = 3: has no effect without"));
  EXPECT_THAT(message_of(set + "held_out: {max_fraction: 1.5}"),
              HasSubstr("held_out.max_fraction is 1.5; use a number above 0 and at most 1"));
}

TEST(RunConfig, SeedReachesEnvAndPolicyUnlessTheySayOtherwise) {
  const RunConfig config = parse_run_config("seed: 7\npolicy: {seed: 9}", "run.yaml", {"env.task.max_steps=33"});
  EXPECT_EQ(config.env.seed, 7u);
  EXPECT_EQ(config.policy.seed, 9u);
  EXPECT_EQ(config.env.task.max_steps, 33);
}

// Sets of evaluations stay what they were: a goal per episode.
TEST(RunConfig, TrainingSharesGoalsAndEvaluationDoesNot) {
  const RunConfig config = parse_run_config("", "run.yaml", {});
  EXPECT_EQ(config.train.goals_per_scene, 10);
  EXPECT_EQ(config.eval.goals_per_scene, 0);
  EXPECT_FALSE(generator_keys(config.eval, config.env).contains("data.goals_per_scene"));
  EXPECT_EQ(generator_keys(config.train, config.env).at("data.goals_per_scene"), "10");
  EXPECT_THAT(message_of("data: {train: {goals_per_scene: -1}}"),
              HasSubstr("data.train.goals_per_scene is -1; use a whole number from 0 to 100,000"));
  EXPECT_THAT(message_of("data: {eval: {goal_per_scene: 1}}"), HasSubstr("did you mean 'goals_per_scene'"));
}

// What a checkpoint holds: all keys, so that it means the same when the defaults have changed.
TEST(RunConfig, TextHoldsEveryKeyAndReadsBackTheSame) {
  const RunConfig config = parse_run_config(
      "name: a\nseed: 7\nenv: {acoustics: {preset: fast}, task: {forward_m: 0.1}}\nppo: {learning_rate: 1.0e-7}\n"
      "data: {train: {scenes: [\"house:1..3,rooms=2\"], filter: {min_ratio: 1.05}}}",
      "run.yaml", {});
  const std::string text = config_text(config);
  EXPECT_EQ(config_text(parse_run_config(text, "checkpoint", {})), text);
  const auto flat = flat_config(text);
  EXPECT_EQ(flat.at("out"), "runs/a");
  EXPECT_EQ(flat.at("policy.seed"), "7");
  EXPECT_EQ(flat.at("env.task.turn_deg"), "10");
  EXPECT_EQ(flat.at("keep"), "3");
  const RunConfig again = parse_run_config(text, "checkpoint", {});
  EXPECT_EQ(again.env.acoustics.rays, config.env.acoustics.rays);
  EXPECT_EQ(again.env.task.forward_m, config.env.task.forward_m);
  EXPECT_EQ(again.ppo.learning_rate, config.ppo.learning_rate);
}

// A setting without effect is refused where it is typed, and not recorded where it is a default.
TEST(RunConfig, ARunWithFieldsReadsBackTheSame) {
  for (const char* late : {"field: on", "source_rays: 16", "specular_exponent: 30"}) {
    const std::string text = config_text(parse_run_config(fmt::format("env: {{acoustics: {{{}}}}}", late), "run.yaml", {}));
    EXPECT_EQ(config_text(parse_run_config(text, "checkpoint", {})), text) << late;
  }
  EXPECT_THROW(parse_run_config("env: {acoustics: {field: on, diffuse_last_segment: true}}", "run.yaml", {}), InputError);
}

TEST(RunConfig, AnOverrideThatACheckpointWouldIgnoreIsRefused) {
  const std::string text = config_text(parse_run_config("", "run.yaml", {}));
  EXPECT_EQ(parse_effective_config(text, "checkpoint", {"env.acoustics.rays=7"}).env.acoustics.rays, 7);
  EXPECT_THROW(parse_effective_config(text, "checkpoint", {"env.acoustics.preset=high"}), InputError);
  EXPECT_THROW(parse_effective_config(text, "checkpoint", {"seed=2"}), InputError);
}

// The configs that ship with the product must stay readable, from the project's folder as the README says.
TEST(RunConfig, ShippedConfigsAreValid) {
  std::filesystem::current_path(source_dir());
  for (const char* name : {"quick", "houses", "small_house", "avnav"})
    EXPECT_NO_THROW(load_run_config(source_dir() / "configs/train" / (std::string(name) + ".yaml"), {})) << name;
}

}  // namespace
}  // namespace earshot
