#include <gtest/gtest.h>

#include <algorithm>
#include <thread>
#include <vector>

#include "sim/acoustics/geometry/diffraction_edges.h"
#include "tests/support/rooms.h"

namespace earshot {
namespace {

TEST(DiffractionEdges, NeighboursAreThoseInSightFromAnyThread) {
  // Two boxes side by side and a third far behind a wall between.
  TriangleMesh mesh;
  append_box(mesh, {0, 0, 0}, {1, 1, 1}, 0, 0);
  append_box(mesh, {3, 0, 0}, {4, 1, 1}, 0, 0);
  append_box(mesh, {8, -50, -50}, {9, 50, 50}, 0, 0);
  append_box(mesh, {12, 0, 0}, {13, 1, 1}, 0, 0);
  const auto scene = rooms::scene_of(mesh, {Material::uniform("hard", 0.f, 0.f)});
  const DiffractionEdges edges(*scene, 0.25f), alone(*scene, 0.25f);
  std::vector<std::thread> threads;
  for (int t = 0; t < 4; ++t)
    threads.emplace_back([&] {
      for (std::uint32_t e = 0; e < edges.size(); ++e) EXPECT_LT(edges.neighbours(e).size(), edges.size());
    });
  for (std::thread& thread : threads) thread.join();
  int pairs = 0;
  for (std::uint32_t e = 0; e < edges.size(); ++e) {
    const auto parallel = edges.neighbours(e), serial = alone.neighbours(e);
    EXPECT_TRUE(std::equal(parallel.begin(), parallel.end(), serial.begin(), serial.end()));
    for (const std::uint32_t other : parallel) {
      ++pairs;
      const auto back = edges.neighbours(other);
      EXPECT_TRUE(std::binary_search(back.begin(), back.end(), e));  // sight goes both ways
      const double x = edges[e].at(0.5).x, y = edges[other].at(0.5).x;
      EXPECT_FALSE((x < 5 && y > 10) || (y < 5 && x > 10));
    }
  }
  EXPECT_GT(pairs, 48);
}

}  // namespace
}  // namespace earshot
