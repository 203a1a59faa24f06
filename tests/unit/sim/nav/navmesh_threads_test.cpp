// SPDX-License-Identifier: Apache-2.0
#include <gtest/gtest.h>

#include <array>
#include <cmath>
#include <thread>
#include <vector>

#include "sim/nav/geodesic_field.h"
#include "sim/nav/motion.h"
#include "sim/nav/navmesh.h"
#include "sim/scene/generators/house_generator.h"

namespace earshot {
namespace {

// All queries from eight threads give the bits that one thread gives, whichever pooled query object serves them.
TEST(NavmeshThreads, AnyThreadGivesTheSameBits) {
  const Navmesh nav(generate_house({.seed = 3, .rooms = 3, .area_m2 = 36}), {});
  const RandomStream random(5, Purpose::test);
  const GeodesicField field(nav, nav.random_point(random, 999));
  constexpr int count = 400;
  const auto roll = [&](int i) {
    glm::vec3 position = nav.random_point(random, static_cast<std::uint32_t>(2 * i));
    std::array<float, 5> bits{};
    for (int step = 0; step < 20; ++step) {
      const float angle = 6.28f * random.uniform(static_cast<std::uint32_t>(5000 + 20 * i + step));
      const MoveResult move = slide(nav, position, {0.15f * std::sin(angle), 0, 0.15f * std::cos(angle)});
      position = move.position;
      bits[3] += field.distance_m(position).value_or(-1);
      bits[4] += move.collided ? 1.f : 0.f;
    }
    bits[0] = position.x, bits[1] = position.y, bits[2] = position.z;
    return bits;
  };
  std::vector<std::array<float, 5>> expected(count), got(count);
  for (int i = 0; i < count; ++i) expected[i] = roll(i);
  std::vector<std::jthread> threads;
  for (int t = 0; t < 8; ++t)
    threads.emplace_back([&, t] {
      for (int i = count - 1 - t; i >= 0; i -= 8) got[i] = roll(i);
    });
  threads.clear();
  EXPECT_EQ(got, expected);
}

}  // namespace
}  // namespace earshot
