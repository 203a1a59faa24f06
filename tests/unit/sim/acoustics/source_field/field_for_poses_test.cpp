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

}  // namespace
}  // namespace earshot
