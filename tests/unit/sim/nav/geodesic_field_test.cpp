// SPDX-License-Identifier: Apache-2.0
#include "sim/nav/geodesic_field.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <functional>
#include <limits>
#include <numbers>
#include <numeric>
#include <queue>
#include <vector>

#include "sim/base/errors.h"
#include "sim/nav/corridor.h"
#include "sim/nav/motion.h"
#include "sim/scene/generators/house_generator.h"
#include "tests/support/envs/nav_scenes.h"

namespace earshot {
namespace {

TEST(GeodesicField, StraightInTheOpen) {
  const Navmesh nav(floor_with(8, 6, {}), {});
  const GeodesicField field(nav, {1, 0.3f, 1});
  EXPECT_NEAR(field.goal().y, 0.f, 1e-5f);
  for (const glm::vec3 point : {glm::vec3{7, 0, 5}, {1, 0, 1}, {4, 0, 1.5f}, {1.2f, 0, 5.1f}}) {
    ASSERT_TRUE(field.distance_m(point));
    EXPECT_NEAR(*field.distance_m(point), flat_distance(point, {1, 0, 1}), 1e-3f);  // starts stand 0.2 mm off walls
    EXPECT_EQ(*field.next_corner(point), field.goal());
  }
}

// The way past a corner that keeps the agent `radius` off: two tangents and an arc (closed form).  The line from a point at (ahead, beside)
// meters of the corner turns onto the axis along which `ahead` is counted.
struct Bend {
  double tangent_m, turn_rad;
};
Bend bend_to_axis(double ahead, double beside, double radius) {
  const double distance = std::hypot(ahead, beside);
  return {std::sqrt(distance * distance - radius * radius), std::atan2(beside, ahead) + std::asin(radius / distance)};
}

TEST(GeodesicField, AroundOneBlockByTangentsAndArcs) {
  // Block from x = 3 to 5, z = 0 to 3, in a room 8 x 6: the way from left to right passes both corners at z = 3.
  const Navmesh nav(floor_with(8, 6, {{3, -0.5f, 5, 3}}), {});
  const glm::vec3 from{1, 0, 1}, goal{7, 0, 1};
  const GeodesicField field(nav, goal);
  // How far the border stands off the block, the surface itself says: the agent's radius and up to a cell more.
  const double radius = static_cast<double>(nav.snap({4, 0, 2.8f}, 1.f)->z - 3.f);
  EXPECT_GE(radius, 0.099);
  EXPECT_LE(radius, 0.151);
  const Bend bend = bend_to_axis(2, 2, radius);
  const double expected = 2 * (bend.tangent_m + radius * bend.turn_rad) + 2.0;
  EXPECT_NEAR(field.distance_m(from).value(), expected, 0.02);  // 0.25 %: the arc is a chain of cell corners
  EXPECT_NEAR(flat_distance(*field.next_corner(from), {3, 0, 3}), radius, 0.08f);
  EXPECT_NEAR(flat_distance(*field.next_corner({4.4f, 0, 3.3f}), {5, 0, 3}), radius, 0.08f);
  EXPECT_EQ(*field.next_corner({6, 0, 4}), field.goal());
}

// An agent on a corner of its way, or within millimetres of it, is sent on to the next one.
TEST(GeodesicField, FromACornerTheWayLeadsOn) {
  const Navmesh nav(floor_with(8, 6, {{3, -0.5f, 5, 3}}), {});
  const glm::vec3 goal{7, 0, 1};
  const GeodesicField field(nav, goal);
  glm::vec3 at{1, 0, 1};
  double left_m = *field.distance_m(at);
  int corners = 0;
  while (glm::distance(at, field.goal()) > 1e-3f) {
    ASSERT_LT(++corners, 20) << "the same corner again";
    const glm::vec3 next = *field.next_corner(at);
    EXPECT_GT(flat_distance(next, at), 0.01) << "not the corner that the agent stands on";
    for (int k = 0; k < 17 && next != field.goal(); ++k) {
      const float off_m = k == 0 ? 0.f : k % 2 == 0 ? 0.002f : 0.005f, angle = static_cast<float>(k) * 2 * std::numbers::pi_v<float> / 16;
      const glm::vec3 beside = next + off_m * glm::vec3(std::cos(angle), 0, std::sin(angle));
      const glm::vec3 after = *field.next_corner(beside);
      EXPECT_GT(flat_distance(after, next), 0.02) << off_m << " m from corner " << corners << ", toward " << angle;
      EXPECT_LT(*field.distance_m(after), *field.distance_m(next));
    }
    EXPECT_LT(*field.distance_m(next), left_m);
    left_m = *field.distance_m(next);
    at = next;
  }
  EXPECT_GE(corners, 3) << "past both corners of the block to the goal";
}

TEST(GeodesicField, LShapedCorridor) {
  // Two corridors 1 m wide at a right angle; the inner corner is at (1, 1).
  const Navmesh nav(floor_with(6, 6, {{1, 1, 6.5f, 6.5f}}), {});
  const glm::vec3 from{0.5f, 0, 5}, goal{5, 0, 0.5f};
  const double radius = 1.0 - static_cast<double>(nav.snap({1.3f, 0, 3}, 1.f)->x);
  EXPECT_GE(radius, 0.099);
  EXPECT_LE(radius, 0.151);
  // 4 m ahead and 0.5 m to the free side of each corridor's wall: tangent to the arc, and pi/2 less both slants around it.
  const double distance = std::hypot(4.0, 0.5), slant = std::atan2(0.5, 4.0) - std::asin(radius / distance);
  const double expected = 2 * std::sqrt(distance * distance - radius * radius) + radius * (std::numbers::pi / 2 - 2 * slant);
  EXPECT_NEAR(GeodesicField(nav, goal).distance_m(from).value(), expected, 0.02);
  EXPECT_NEAR(nav.path_length_m(from, goal).value(), expected, 0.02);
}

TEST(GeodesicField, NoPathIsNullopt) {
  const Navmesh nav(floor_with(6, 4, {{2.9f, -0.1f, 3.1f, 4.1f}}), {});
  const GeodesicField field(nav, {1, 0, 2});
  EXPECT_FALSE(field.distance_m({5, 0, 2}));
  EXPECT_FALSE(field.next_corner({5, 0, 2}));
  EXPECT_FALSE(field.distance_m({20, 0, 2}));
  EXPECT_FALSE(field.distance_m({std::numeric_limits<float>::quiet_NaN(), 0, 2}));
  EXPECT_TRUE(field.distance_m({1, 0, 3}));
}

TEST(GeodesicField, RefusesAGoalOffTheSurface) {
  const Navmesh nav(floor_with(6, 4, {}), {});
  EXPECT_THROW(GeodesicField(nav, {9, 0, 2}), InputError);
  EXPECT_THROW(GeodesicField(nav, {3, 5, 2}), InputError);
  EXPECT_THROW(GeodesicField(nav, {std::numeric_limits<float>::infinity(), 0, 2}), InputError);
  EXPECT_NO_THROW(GeodesicField(nav, {-0.5f, 0, 2}));  // 1 m of reach
}

// An independent oracle: Dijkstra on a 3 cm grid of points that the surface holds, to all coprime neighbours within 5 cells (directions
// at most 5.7 degrees off, so at most 1 / cos(5.7 deg) = 1.005 too long).
class GridOracle {
 public:
  GridOracle(const Navmesh& nav, glm::vec3 lower, glm::vec3 upper) : lower_(lower) {
    columns_ = static_cast<int>((upper.x - lower.x) / kCellM) + 1;
    rows_ = static_cast<int>((upper.z - lower.z) / kCellM) + 1;
    free_.resize(static_cast<std::size_t>(columns_ * rows_));
    for (int z = 0; z < rows_; ++z)
      for (int x = 0; x < columns_; ++x) {
        const auto snapped = nav.snap(at(x, z), 0.02f);
        free_[index(x, z)] = snapped && snapped->y < 0.1f && flat_distance(*snapped, at(x, z)) < 1e-4f;
      }
    for (int dz = -5; dz <= 5; ++dz)
      for (int dx = -5; dx <= 5; ++dx)
        if (std::gcd(dx, dz) == 1) steps_.push_back({dx, dz});
  }

  [[nodiscard]] std::vector<float> distances_from(glm::vec3 goal) const {
    std::vector<float> distance(free_.size(), std::numeric_limits<float>::infinity());
    using Entry = std::pair<float, int>;
    std::priority_queue<Entry, std::vector<Entry>, std::greater<>> open;
    // Start from the cells around the goal, each at its true distance.
    for (int z = 0; z < rows_; ++z)
      for (int x = 0; x < columns_; ++x)
        if (const float d = flat_distance(at(x, z), goal); free_[index(x, z)] && d < 0.05f) {
          distance[index(x, z)] = d;
          open.push({d, static_cast<int>(index(x, z))});
        }
    while (!open.empty()) {
      const auto [d, cell] = open.top();
      open.pop();
      if (d > distance[cell]) continue;
      const int x = cell % columns_, z = cell / columns_;
      for (const auto& [dx, dz] : steps_) {
        const int nx = x + dx, nz = z + dz;
        if (nx < 0 || nz < 0 || nx >= columns_ || nz >= rows_ || !is_free_between(x, z, dx, dz)) continue;
        const float next = d + kCellM * std::hypot(static_cast<float>(dx), static_cast<float>(dz));
        if (next >= distance[index(nx, nz)]) continue;
        distance[index(nx, nz)] = next;
        open.push({next, static_cast<int>(index(nx, nz))});
      }
    }
    return distance;
  }

  // The nearest free grid point, and its index.
  [[nodiscard]] std::pair<glm::vec3, std::size_t> free_point(std::uint32_t pick) const {
    std::size_t cell = pick % free_.size();
    while (!free_[cell]) cell = (cell + 1) % free_.size();
    return {at(static_cast<int>(cell) % columns_, static_cast<int>(cell) / columns_), cell};
  }

 private:
  static constexpr float kCellM = 0.03f;
  [[nodiscard]] glm::vec3 at(int x, int z) const {
    return lower_ + glm::vec3(kCellM * static_cast<float>(x), 0, kCellM * static_cast<float>(z));
  }
  [[nodiscard]] std::size_t index(int x, int z) const { return static_cast<std::size_t>(z * columns_ + x); }
  [[nodiscard]] bool is_free_between(int x, int z, int dx, int dz) const {
    const int samples = 2 * std::max(std::abs(dx), std::abs(dz));
    for (int s = 1; s <= samples; ++s) {
      const int cx = x + static_cast<int>(std::lround(static_cast<float>(dx * s) / static_cast<float>(samples)));
      const int cz = z + static_cast<int>(std::lround(static_cast<float>(dz * s) / static_cast<float>(samples)));
      if (!free_[index(cx, cz)]) return false;
    }
    return true;
  }

  glm::vec3 lower_;
  int columns_ = 0, rows_ = 0;
  std::vector<char> free_;
  std::vector<std::pair<int, int>> steps_;
};

TEST(GeodesicField, AgreesWithAGridSearchInFurnishedHouses) {
  for (const std::uint64_t seed : {1u, 4u}) {
    const TriangleMesh mesh = generate_house({.seed = seed, .rooms = 3, .area_m2 = 36});
    const Navmesh nav(mesh, {});
    const Bounds bounds = bounds_of(mesh);
    const GridOracle grid(nav, {bounds.lower.x, 0, bounds.lower.z}, bounds.upper);
    const RandomStream random(seed, Purpose::test);
    for (std::uint32_t g = 0; g < 4; ++g) {
      const glm::vec3 goal = nav.random_point(random, 2 * g);
      const GeodesicField field(nav, goal);
      const std::vector<float> oracle = grid.distances_from(goal);
      double sum_ratio = 0;
      int count = 0;
      for (std::uint32_t i = 0; i < 300; ++i) {
        const auto [point, cell] = grid.free_point(random.bits(100 + 300 * g + i));
        const auto got = field.distance_m(point);
        if (std::isinf(oracle[cell])) continue;  // pockets that the grid cannot enter
        ASSERT_TRUE(got);
        // Never longer than the grid's path (1 mm per corner, 1 cm of slack at either end), never shorter than its directions and its 3 cm
        // corners allow.
        EXPECT_LE(*got, oracle[cell] * 1.001f + 0.02f);
        EXPECT_GE(*got, oracle[cell] / 1.006f - 0.08f);
        if (*got > 1.f) sum_ratio += static_cast<double>(*got / oracle[cell]), ++count;
      }
      EXPECT_NEAR(sum_ratio / count, 1.0, 0.01);
    }
  }
}

class HouseField : public ::testing::Test {
 protected:
  Navmesh nav_{generate_house({.seed = 9, .rooms = 4, .area_m2 = 60}), {}};
  RandomStream random_{21, Purpose::test};
};

TEST_F(HouseField, EveryPointOfTheMainIslandHasAPath) {
  for (std::uint32_t g = 0; g < 10; ++g) {
    const glm::vec3 goal = nav_.random_point(random_, 2 * g);
    const GeodesicField field(nav_, goal);
    for (std::uint32_t i = 0; i < 500; ++i) {
      const glm::vec3 point = nav_.random_point(random_, 100 + 2 * i);
      const auto distance = field.distance_m(point);
      ASSERT_TRUE(distance);
      ASSERT_TRUE(std::isfinite(*distance));
      EXPECT_GE(*distance, flat_distance(point, goal) - 1e-3f);
    }
  }
}

// Detour's search is another algorithm on the same polygons: its taut corridor is a path, so the geodesic is at most as long, and most are
// equal.
TEST_F(HouseField, IsNeverLongerThanDetoursCorridor) {
  int num_equal = 0;
  for (std::uint32_t i = 0; i < 200; ++i) {
    const glm::vec3 a = nav_.random_point(random_, 4 * i), b = nav_.random_point(random_, 4 * i + 2);
    const auto corridor_m = corridor_length_m(nav_, a, b);
    ASSERT_TRUE(corridor_m);
    const double shortest_m = static_cast<double>(nav_.path_length_m(a, b).value());
    EXPECT_LE(shortest_m, *corridor_m + 0.01);  // up to ten corners, 1 mm each
    EXPECT_GE(shortest_m, 0.6 * *corridor_m - 0.01);
    num_equal += shortest_m > 0.99 * *corridor_m - 0.01;
  }
  EXPECT_GT(num_equal, 150);
}

TEST_F(HouseField, IsSymmetric) {
  for (std::uint32_t i = 0; i < 300; ++i) {
    const glm::vec3 a = nav_.random_point(random_, 4 * i), b = nav_.random_point(random_, 4 * i + 2);
    const float forth = nav_.path_length_m(a, b).value(), back = nav_.path_length_m(b, a).value();
    EXPECT_NEAR(forth, back, 1e-3f + 1e-3f * forth);
  }
}

TEST_F(HouseField, ChangesByNoMoreThanTheStep) {
  // Walks of 1 cm steps, walls and corners of furniture included: a distance is a 1-Lipschitz function of the place.
  float worst = 0;
  for (std::uint32_t walk = 0; walk < 30; ++walk) {
    const GeodesicField field(nav_, nav_.random_point(random_, 2 * walk));
    glm::vec3 position = nav_.random_point(random_, 1000 + 2 * walk);
    float before = field.distance_m(position).value();
    for (std::uint32_t step = 0; step < 600; ++step) {
      const float angle = 6.2832f * random_.uniform(5000 + 100 * walk + step / 60);
      const MoveResult move = slide(nav_, position, {0.01f * std::sin(angle), 0, 0.01f * std::cos(angle)});
      position = move.position;
      const auto distance = field.distance_m(position);
      ASSERT_TRUE(distance);
      worst = std::max(worst, std::abs(*distance - before));
      before = *distance;
    }
  }
  EXPECT_LE(worst, 0.012f);  // the step, and the millimetres that corners stand off their vertices
}

TEST_F(HouseField, NextCornerLeadsToTheGoal) {
  for (std::uint32_t walk = 0; walk < 30; ++walk) {
    const GeodesicField field(nav_, nav_.random_point(random_, 2 * walk));
    glm::vec3 position = nav_.random_point(random_, 1000 + 2 * walk);
    float distance = field.distance_m(position).value();
    float walked_m = 0;
    const float start_m = distance;
    for (int step = 0; step < 4000 && distance > 0.02f; ++step) {
      const glm::vec3 corner = field.next_corner(position).value();
      const float to_corner = flat_distance(corner, position);
      ASSERT_GT(to_corner, 0.f);
      const float length_m = std::min(0.02f, to_corner);
      glm::vec3 displacement = (corner - position) * (length_m / to_corner);
      const glm::vec3 next = slide(nav_, position, displacement).position;
      walked_m += flat_distance(next, position);
      position = next;
      const float now = field.distance_m(position).value();
      ASSERT_LT(now, distance + 1e-4f) << "walk " << walk << " step " << step;
      distance = now;
    }
    EXPECT_LE(distance, 0.02f);
    EXPECT_NEAR(walked_m, start_m, 0.03f + 0.01f * start_m);
  }
}

TEST_F(HouseField, SameBitsForEveryField) {
  const glm::vec3 goal = nav_.random_point(random_, 0);
  const GeodesicField first(nav_, goal), second(nav_, goal);
  for (std::uint32_t i = 0; i < 200; ++i) {
    const glm::vec3 point = nav_.random_point(random_, 10 + 2 * i);
    EXPECT_EQ(first.distance_m(point), second.distance_m(point));
    EXPECT_EQ(first.next_corner(point), second.next_corner(point));
  }
}

}  // namespace
}  // namespace earshot
