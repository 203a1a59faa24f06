// SPDX-License-Identifier: Apache-2.0
#include "trainer/run/field_decision.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <unistd.h>

#include "envs/episodes/episode_set.h"

namespace earshot {
namespace {

using testing::HasSubstr;

class FieldDecisionTest : public testing::Test {
 protected:
  void SetUp() override {
    EpisodeSet set;
    for (int i = 0; i < 20; ++i) {
      Episode& episode = set.episodes.emplace_back();
      episode.episode_id = std::to_string(i);
      episode.scene_id = "shoebox:6x3x5@0.3";
      episode.goal_position = {i % 2 + 1, 0, 1};
      episode.geodesic_distance_m = 3;
      episode.num_action = 50;
      episode.sound = "synth:bird";
    }
    std::filesystem::create_directories(folder_);
    save_episode_set(set, folder_ / "train.json.gz");
  }
  void TearDown() override { std::filesystem::remove_all(folder_); }
  RunConfig config(const std::vector<std::string>& extra) const {
    std::vector<std::string> overrides{"out=" + (folder_ / "run").string(), "data.train.file=" + (folder_ / "train.json.gz").string()};
    overrides.insert(overrides.end(), extra.begin(), extra.end());
    return parse_run_config("", "run.yaml", overrides);
  }
  const std::filesystem::path folder_ =
      std::filesystem::temp_directory_path() /
      ("earshot_decision_" + std::string(testing::UnitTest::GetInstance()->current_test_info()->name()) + std::to_string(::getpid()));
};

TEST_F(FieldDecisionTest, AutoFollowsTheStepsOfTheRunAndItsFieldsLieInItsFolder) {
  const FieldDecision long_run = decide_field(config({"total_steps=1000000"}));
  EXPECT_EQ(long_run.config.env.acoustics.field, Switch::on);
  EXPECT_EQ(long_run.config.env.field_store, (folder_ / "run" / "fields").string());
  EXPECT_THAT(long_run.text, HasSubstr("auto: on: 2 goals in 1 scenes"));
  const FieldDecision short_run = decide_field(config({"total_steps=100"}));
  EXPECT_EQ(short_run.config.env.acoustics.field, Switch::off);
  EXPECT_EQ(short_run.config.env.field_store, "");
  EXPECT_THAT(short_run.text, HasSubstr("auto: off"));
  EXPECT_EQ(config_text(decide_field(config({"total_steps=1000000"})).config), config_text(long_run.config));
}

TEST_F(FieldDecisionTest, WhatTheConfigSaysStays) {
  const FieldDecision off = decide_field(config({"total_steps=1000000", "env.acoustics.field=off"}));
  EXPECT_EQ(off.config.env.acoustics.field, Switch::off);
  EXPECT_EQ(off.text, "");
  const FieldDecision on = decide_field(config({"total_steps=1", "env.acoustics.field=on", "env.field_store=elsewhere"}));
  EXPECT_EQ(on.config.env.acoustics.field, Switch::on);
  EXPECT_EQ(on.config.env.field_store, "elsewhere");
  const FieldDecision deaf = decide_field(config({"env.observation.spectrogram=false"}));
  EXPECT_EQ(deaf.config.env.acoustics.field, Switch::automatic);
  const FieldDecision without_set = decide_field(config({"data.train.file=" + (folder_ / "none").string()}));
  EXPECT_EQ(without_set.config.env.acoustics.field, Switch::off);
}

}  // namespace
}  // namespace earshot
