// SPDX-License-Identifier: Apache-2.0
#include <gtest/gtest.h>

#include <array>
#include <thread>
#include <vector>

#include "sim/base/random.h"
#include "tests/support/files/triangle_soups.h"

namespace earshot {
namespace {

using namespace soups;

TEST(EmbreeScene, ThreadsSeeTheSameHits) {
  const EmbreeScene scene = build(tessellated_cube(9, 2, 0));
  const auto trace = [&] {
    std::vector<float> distances;
    for (std::uint32_t i = 0; i < 5000; ++i) {
      distances.push_back(scene.intersect(glm::vec3(0.7f), uniform_direction(RandomStream(8, Purpose::test, i).uniform2(0))).distance_m);
    }
    return distances;
  };
  const std::vector<float> expected = trace();
  std::array<std::vector<float>, 4> seen;
  std::vector<std::thread> threads;
  for (auto& result : seen) threads.emplace_back([&] { result = trace(); });
  for (std::thread& thread : threads) thread.join();
  for (const auto& result : seen) EXPECT_EQ(result, expected);
}

}  // namespace
}  // namespace earshot
