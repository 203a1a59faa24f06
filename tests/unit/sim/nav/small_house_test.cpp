// SPDX-License-Identifier: Apache-2.0
#include <gtest/gtest.h>

#include <cmath>
#include <cstdlib>
#include <filesystem>

#include "sim/nav/geodesic_field.h"
#include "sim/nav/motion.h"
#include "sim/nav/navmesh.h"
#include "sim/scene/readers/mesh_import.h"
#include "tests/support/files/test_data.h"

namespace earshot {
namespace {

float flat(glm::vec3 a, glm::vec3 b) { return std::hypot(a.x - b.x, a.z - b.z); }

// A modelled house: 19 x 11 m, sloppy triangles, no ceiling.  What holds in generated houses holds here.
class SmallHouse : public ::testing::Test {
 protected:
  void SetUp() override {
    SKIP_WITHOUT_DATA("scenes/small_house_collision.glb");
    nav_ = std::make_unique<Navmesh>(import_mesh(data_folder() / "scenes/small_house_collision.glb").mesh, NavmeshConfig{});
  }
  std::unique_ptr<Navmesh> nav_;
  RandomStream random_{4, Purpose::test};
};

TEST_F(SmallHouse, MostOfTheFloorIsOneIsland) {
  EXPECT_GT(nav_->main_area_m2(), 100.f);  // of 209 m2 outline, less walls, furniture and the agent's radius
  EXPECT_LT(nav_->main_area_m2(), 19.f * 11.f);
}

TEST_F(SmallHouse, DistancesAreFiniteSymmetricAndNoShorterThanStraight) {
  for (std::uint32_t i = 0; i < 500; ++i) {
    const glm::vec3 a = nav_->random_point(random_, 4 * i), b = nav_->random_point(random_, 4 * i + 2);
    const auto forth = nav_->path_length_m(a, b), back = nav_->path_length_m(b, a);
    ASSERT_TRUE(forth && back);
    EXPECT_NEAR(*forth, *back, 2e-3f + 2e-3f * *forth);
    EXPECT_GE(*forth, flat(a, b) - 1e-3f);
  }
}

TEST_F(SmallHouse, WalksKeepToTheSurfaceAndTheFieldFollows) {
  int collisions = 0;
  for (std::uint32_t walk = 0; walk < 20; ++walk) {
    const GeodesicField field(*nav_, nav_->random_point(random_, 5000 + 2 * walk));
    glm::vec3 position = nav_->random_point(random_, 6000 + 2 * walk);
    float before = field.distance_m(position).value();
    for (std::uint32_t step = 0; step < 300; ++step) {
      const float angle = 6.2832f * random_.uniform(9000 + 50 * walk + step / 8), length_m = step % 2 == 0 ? 0.15f : 0.01f;
      const MoveResult move = slide(*nav_, position, {length_m * std::sin(angle), 0, length_m * std::cos(angle)});
      const auto distance = field.distance_m(move.position);
      ASSERT_TRUE(distance);
      // What was walked bounds what the distance may change by: 3 mm for corners that stand off, 5 % for uneven ground.
      ASSERT_LE(std::abs(*distance - before), 1.05f * length_m + 0.003f);
      ASSERT_LE(flat(move.position, position), length_m + 2e-4f);
      collisions += move.collided;
      position = move.position;
      before = *distance;
    }
  }
  EXPECT_GT(collisions, 500);
}

}  // namespace
}  // namespace earshot
