// SPDX-License-Identifier: Apache-2.0
#include "sim/acoustics/source_field/field_for_poses.h"

#include <gtest/gtest.h>

#include "sim/scene/scene.h"
#include "tests/support/acoustics/rooms.h"

namespace earshot {
namespace {

// A furnished house needs thousands of rays per response, so a field pays for many poses; in free air nothing comes back.
TEST(FieldForPoses, PaysForManyPosesOfAHouse) {
  const std::shared_ptr<const Scene> house = std::make_shared<const Scene>(load_scene("house:7")), air = rooms::empty();
  const auto wants = [](const std::shared_ptr<const Scene>& scene, Switch field, std::size_t num_poses) {
    AcousticConfig config;
    config.field = field;
    return wants_source_field(AcousticScene(scene, config), num_poses);
  };
  for (const std::size_t num_poses : {1u, 299u, 300u, 100'000u}) {
    EXPECT_EQ(wants(house, Switch::automatic, num_poses), num_poses >= 300) << num_poses;
    EXPECT_FALSE(wants(air, Switch::automatic, num_poses)) << num_poses;
    EXPECT_FALSE(wants(house, Switch::off, num_poses)) << num_poses;
    EXPECT_TRUE(wants(house, Switch::on, num_poses)) << num_poses;
  }
}

TEST(FieldForPoses, IsBuiltWhereItIsWanted) {
  AcousticConfig config = acoustic_preset("fast");
  config.rir_length_s = 0.2f;
  config.field_error = 0.2f;
  config.field = Switch::on;
  const AcousticScene with_field(rooms::shoe1(0.2, 0.3), config);
  const EarlyCandidates candidates(with_field, rooms::shoe1_source());
  EXPECT_NE(field_for_poses(with_field, candidates, 1), nullptr);
  config.field = Switch::off;
  const AcousticScene without_field(rooms::shoe1(0.2, 0.3), config);
  EXPECT_EQ(field_for_poses(without_field, EarlyCandidates(without_field, rooms::shoe1_source()), 100'000), nullptr);
}

TEST(FieldForPoses, AutomaticIsOffForFewPoses) {
  EXPECT_EQ(field_switch_for_poses(Switch::automatic, 299), Switch::off);
  EXPECT_EQ(field_switch_for_poses(Switch::automatic, 300), Switch::automatic);
  for (const Switch user_set : {Switch::on, Switch::off})
    for (const std::size_t num_poses : {0u, 300u}) EXPECT_EQ(field_switch_for_poses(user_set, num_poses), user_set);
}

}  // namespace
}  // namespace earshot
