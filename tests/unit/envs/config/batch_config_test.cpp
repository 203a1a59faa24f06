// SPDX-License-Identifier: Apache-2.0
#include "envs/config/batch_config.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "sim/base/errors.h"
#include "sim/base/text/config_reader.h"

namespace earshot {
namespace {

using testing::HasSubstr;

constexpr const char* kEpisodes =
    R"({scenes: ["shoebox:5x3x4@0.2", "shoebox:6x3x5@0.3"], episodes_per_scene: 3, sounds: ["synth:telephone"], filter: {min_geodesic_m: 1, min_ratio: 1}})";
constexpr const char* kEnvKeys = R"({acoustics: {rays: 4, early_order: 1, rir_length_s: 0.1, field: off}, task: {max_steps: 12}})";

std::string run_text(const std::string& split = "train") {
  return std::string("seed: 9\nppo: {no: matter}\nenv: ") + kEnvKeys + "\ndata: {" + split + ": " + kEpisodes + "}\n";
}
std::string batch_text() {
  return std::string("seed: 9\nacoustics: {rays: 4, early_order: 1, rir_length_s: 0.1, field: off}\ntask: {max_steps: 12}\nepisodes: ") +
         kEpisodes + "\n";
}
BatchParts parts_of(const std::string& yaml, const std::vector<std::string>& env_overrides = {}, const std::string& split = "train") {
  return read_batch(yaml, "the text", {}, env_overrides, split);
}
std::string message_of(const std::string& yaml, const std::string& split = "train") {
  try {
    parts_of(yaml, {}, split);
  } catch (const InputError& error) {
    return error.what();
  }
  return "";
}

TEST(BatchConfig, ARunConfigAndItsEnvSectionAloneGiveTheSameEnvironments) {
  const BatchParts run = parts_of(run_text("eval"), {}, "eval"), batch = parts_of(batch_text());
  EXPECT_EQ(config_text(run.config), config_text(batch.config));
  EXPECT_EQ(run.config.seed, 9u);
  ASSERT_EQ(run.set->episodes.size(), 6u);
  EXPECT_EQ(run.set->episodes[5].episode_id, "5");
  EXPECT_EQ(run.set->hash, batch.set->hash);
}

TEST(BatchConfig, EpisodesOfATrainingShareTheirGoals) {
  EXPECT_EQ(training_data().goals_per_scene, 10);
  EXPECT_NE(parts_of(run_text()).set->hash, parts_of(run_text("eval"), {}, "eval").set->hash);
}

TEST(BatchConfig, OverridesOfTheEnvironmentsReachThemInBothForms) {
  EXPECT_EQ(parts_of(run_text(), {"task.max_steps=7"}).config.task.max_steps, 7);
  EXPECT_EQ(parts_of(batch_text(), {"task.max_steps=7"}).config.task.max_steps, 7);
}

TEST(BatchConfig, AsManyAgentsInTheEpisodesAsInTheEnvironments) {
  EXPECT_EQ(parts_of(batch_text(), {"agents=2"}).set->episodes.front().other_agents.size(), 1u);
}

TEST(BatchConfig, MissingEpisodesAreNamed) {
  EXPECT_THAT(message_of("seed: 1"), HasSubstr("episodes: is missing; give `scenes` and `sounds`, or a `file` of episodes"));
  EXPECT_THAT(message_of("episodes: {sounds: [\"synth:telephone\"]}"), HasSubstr("episodes.scenes: is missing"));
  EXPECT_THAT(message_of("episodes: {scenes: [\"shoebox:5x3x4@0.2\"]}"), HasSubstr("episodes.sounds: is missing"));
  EXPECT_THAT(message_of(run_text(), "eval"), HasSubstr("data.eval: is missing; it describes the episodes"));
}

TEST(BatchConfig, UnknownKeysOfTheSectionsThatAreReadAreRefused) {
  EXPECT_THAT(message_of("env: {tasks: {}}\ndata: {train: {}}"), HasSubstr("did you mean 'task'"));
  EXPECT_THAT(message_of("episodes: {scenes: [\"shoebox:5x3x4@0.2\"], sounds: [\"synth:telephone\"], goal_per_scene: 1}"),
              HasSubstr("did you mean 'goals_per_scene'"));
}

TEST(BatchConfig, TheSplitsOfARunKeepTheirDefaults) {
  ConfigReader run = ConfigReader::from_text("data: {train: {seed: 3}, eval: {seed: 4}, held_out: {seed: 5}}", "the text");
  DataConfig train = training_data(), eval, held_out;
  read_data_section(run, train, eval, held_out);
  EXPECT_EQ(train.seed, 3u);
  EXPECT_EQ(train.goals_per_scene, 10);
  EXPECT_EQ(eval.seed, 4u);
  EXPECT_EQ(eval.goals_per_scene, 0);
  EXPECT_EQ(held_out.seed, 5u);
  EXPECT_EQ(held_out.goals_per_scene, 0);
  ConfigReader other = ConfigReader::from_text("data: {test: {seed: 3}}", "the text");
  EXPECT_THROW(read_data_section(other, train, eval, held_out), InputError);
}

}  // namespace
}  // namespace earshot
