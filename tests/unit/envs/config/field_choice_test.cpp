// SPDX-License-Identifier: Apache-2.0
#include "envs/config/field_choice.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

namespace earshot {
namespace {

using testing::HasSubstr;

/// `goals` places in each of `scenes`, each asked for `times` times; 120 actions of the oracle.
EpisodeSet set_of(int scenes, int goals, int times) {
  EpisodeSet set;
  for (int scene = 0; scene < scenes; ++scene)
    for (int episode = 0; episode < goals * times; ++episode) {
      Episode& new_episode = set.episodes.emplace_back();
      new_episode.scene_id = "house:" + std::to_string(scene);
      new_episode.goal_position = {episode % goals, 0, 1};
      new_episode.num_action = 120;
    }
  return set;
}

TEST(FieldChoice, CountsGoalsAndTheWorkOfBothWays) {
  AcousticConfig config;
  config.rays = 64;
  config.field_error = 0.036f;
  const FieldChoice choice = choose_field(config, set_of(3, 10, 4), 30000);
  EXPECT_EQ(choice.scenes, 3u);
  EXPECT_EQ(choice.goals, 30u);
  EXPECT_NEAR(choice.places_per_goal, 400, 1e-9);  // two of five of 1000 steps
  EXPECT_NEAR(choice.photons, 2500, 0.01);         // (1.8 / 0.036)^2
  EXPECT_NEAR(choice.traced_rays, 25600, 1e-6);
  EXPECT_NEAR(choice.field_rays, 2.5 * 2500 + 2.5 * 400, 0.05);
  EXPECT_TRUE(choice.on);
  EXPECT_THAT(choice.text(), HasSubstr("on: 30 goals in 3 scenes, 400 listener positions per goal"));
}

TEST(FieldChoice, OffWhereFewPlacesShareASource) {
  AcousticConfig config;
  config.rays = 64;
  // A goal per episode, each episode once: 48 places of 64 rays are no more than a pass costs.
  const FieldChoice once = choose_field(config, set_of(3, 10, 1), 0);
  EXPECT_NEAR(once.places_per_goal, 48, 1e-9);
  EXPECT_FALSE(once.on);
  EXPECT_TRUE(choose_field(config, set_of(3, 10, 20), 0).on);
  // The fewer rays stand against it, the more places it takes.
  config.rays = 8;
  EXPECT_FALSE(choose_field(config, set_of(3, 10, 20), 0).on);
  EXPECT_TRUE(choose_field(config, set_of(3, 10, 20), 3e6).on);
}

TEST(FieldChoice, OffWhereNoFieldCanBe) {
  const EpisodeSet set = set_of(1, 1, 100);
  for (const auto change : {+[](AcousticConfig& c) { c.late = Switch::off; }, +[](AcousticConfig& c) { c.source_rays = 16; },
                            +[](AcousticConfig& c) { c.specular_exponent = 30; }, +[](AcousticConfig& c) { c.rays = 0; }}) {
    AcousticConfig config;
    ASSERT_TRUE(choose_field(config, set, 1e6).on);
    change(config);
    const FieldChoice choice = choose_field(config, set, 1e6);
    EXPECT_FALSE(choice.on);
    EXPECT_THAT(choice.text(), HasSubstr("off: " + choice.unfit));
  }
}

}  // namespace
}  // namespace earshot
