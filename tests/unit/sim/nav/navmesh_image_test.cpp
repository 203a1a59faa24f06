// SPDX-License-Identifier: Apache-2.0
#include "sim/nav/navmesh_image.h"

#include <gtest/gtest.h>

#include <string>

#include "sim/base/errors.h"
#include "sim/nav/geodesic_field.h"
#include "sim/scene/generators/house_generator.h"
#include "tests/support/envs/nav_scenes.h"
#include "tests/support/files/mutate.h"

namespace earshot {
namespace {

TriangleMesh house() { return generate_house(parse_house("4,rooms=4,area_m2=50")); }

TEST(NavmeshImage, EveryQueryGivesTheSameBits) {
  const NavmeshConfig config{.agent_radius_m = 0.15f};
  const Navmesh nav(house(), config);
  const Navmesh back = decode_navmesh(encode_navmesh(nav), config, "memory");
  EXPECT_EQ(back.area_m2(), nav.area_m2());
  EXPECT_EQ(back.main_area_m2(), nav.main_area_m2());
  EXPECT_EQ(back.num_islands(), nav.num_islands());
  EXPECT_EQ(back.config().agent_radius_m, 0.15f);
  const RandomStream random(3, Purpose::test);
  glm::vec3 last = nav.random_point(random, 0);
  const GeodesicField field(nav, last), same_field(back, last);
  for (std::uint32_t i = 1; i < 200; ++i) {
    const glm::vec3 point = nav.random_point(random, 2 * i), same = back.random_point(random, 2 * i);
    EXPECT_EQ(point, same);
    EXPECT_EQ(nav.snap(point + glm::vec3(0.3f, 0.2f, -0.2f)), back.snap(point + glm::vec3(0.3f, 0.2f, -0.2f)));
    EXPECT_EQ(field.distance_m(point), same_field.distance_m(point));
    EXPECT_EQ(field.next_corner(point), same_field.next_corner(point));
    if (i % 20 == 0) {
      EXPECT_EQ(nav.path_length_m(last, point), back.path_length_m(last, point));
    }
    last = point;
  }
  EXPECT_EQ(encode_navmesh(back), encode_navmesh(nav));
}

// Detour reads what its tiles say without a check of its own.
TEST(NavmeshImage, DamagedImagesAreRefusedOrUsable) {
  const Navmesh nav(floor_with(6, 4, {{2, 1, 3, 2}}), {});
  const std::string image = encode_navmesh(nav);
  int refused = 0;
  for (std::uint32_t number = 0; number < 4000; ++number) {
    try {
      const Navmesh back = decode_navmesh(mutated(image, number), {}, "memory");
      const RandomStream random(3, Purpose::test, number);
      const glm::vec3 point = back.random_point(random, 0);
      static_cast<void>(back.snap(point));
      static_cast<void>(back.path_length_m({1, 0, 1}, {5, 0, 3}));
    } catch (const InputError&) {
      ++refused;
    }
  }
  EXPECT_GT(refused, 1000);
  for (std::size_t size = 0; size < image.size(); size += 3) EXPECT_THROW(decode_navmesh(image.substr(0, size), {}, "cut"), InputError);
}

}  // namespace
}  // namespace earshot
