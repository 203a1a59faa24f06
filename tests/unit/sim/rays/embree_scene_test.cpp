// SPDX-License-Identifier: Apache-2.0
#include "sim/rays/embree_scene.h"

#include <gtest/gtest.h>

#include <array>
#include <cmath>
#include <glm/geometric.hpp>
#include <glm/matrix.hpp>
#include <limits>
#include <vector>

#include "sim/base/random.h"
#include "tests/support/files/triangle_soups.h"

namespace earshot {
namespace {

using namespace soups;

glm::vec3 lambert_direction(glm::vec3 normal, std::array<float, 2> u) { return glm::normalize(normal + 0.99999f * uniform_direction(u)); }

struct Leaks {
  std::uint64_t escapes = 0, same_triangle = 0, same_face = 0;
};

Leaks bounce(const EmbreeScene& scene, glm::vec3 centre, unsigned triangles_per_face, std::uint32_t bounces) {
  Leaks leaks;
  glm::vec3 from = centre, direction(0.6f, 0.64f, 0.48f);
  std::uint32_t last = Hit::no_triangle;
  for (std::uint32_t i = 0; i < bounces; ++i) {
    const Hit hit = scene.intersect(from, direction);
    if (!hit.valid()) {
      ++leaks.escapes;
      from = centre;
      last = Hit::no_triangle;
      direction = uniform_direction(RandomStream(7, Purpose::test, i, 1).uniform2(0));
      continue;
    }
    leaks.same_triangle += hit.triangle == last;
    leaks.same_face += last != Hit::no_triangle && hit.triangle / triangles_per_face == last / triangles_per_face;
    last = hit.triangle;
    from = offset_from_surface(hit.position, hit.normal);
    direction = lambert_direction(hit.normal, RandomStream(7, Purpose::test, i).uniform2(0));
  }
  return leaks;
}

// docs/evidence/stability.md, H-7, H-17: at most 1e-5 escapes per bounce with watertight triangles, at any scale and far from the origin.
TEST(EmbreeScene, ClosedCubeKeepsItsRays) {
  constexpr unsigned n = 16;
  constexpr std::uint32_t bounces = 1'000'000;
  struct Case {
    float size_m, offset_m;
  };
  for (const Case c : {Case{1, 0}, Case{1000, 0}, Case{1, 1000}, Case{0.1f, 0}}) {
    const EmbreeScene scene = build(tessellated_cube(n, c.size_m, c.offset_m));
    const Leaks leaks = bounce(scene, glm::vec3(c.offset_m + 0.4f * c.size_m), 2 * n * n, bounces);
    EXPECT_LE(leaks.escapes, bounces / 100'000) << c.size_m << " m, offset " << c.offset_m << " m";
    EXPECT_EQ(leaks.same_triangle, 0u) << c.size_m << " m, offset " << c.offset_m << " m";
    EXPECT_EQ(leaks.same_face, 0u) << c.size_m << " m, offset " << c.offset_m << " m";
  }
}

// Inside an axis-aligned box the distance is the smallest of three quotients.
TEST(EmbreeScene, DistanceInABoxIsTheSlabDistance) {
  constexpr float size_m = 4;
  const EmbreeScene scene = build(tessellated_cube(5, size_m, 0));
  for (std::uint32_t i = 0; i < 20'000; ++i) {
    const RandomStream random(1, Purpose::test, i);
    const auto u = random.uniform4(0);
    const glm::vec3 origin = size_m * (0.02f + 0.96f * glm::vec3(u[0], u[1], u[2]));
    const glm::vec3 direction = uniform_direction(random.uniform2(1));
    double expected = 1e9;
    int wall = 0;
    for (int axis = 0; axis < 3; ++axis) {
      const double d = direction[axis];
      const double distance = d > 0 ? (double{size_m} - origin[axis]) / d : d < 0 ? -origin[axis] / d : 1e9;
      if (distance < expected) {
        expected = distance;
        wall = axis;
      }
    }
    const Hit hit = scene.intersect(origin, direction);
    ASSERT_TRUE(hit.valid());
    EXPECT_NEAR(hit.distance_m, expected, 1e-7 * expected);  // half a unit in the last place is 6e-8
    // A few roundings of float coordinates of 4 m (2.4e-7 each), seen 1 / cos longer.
    const double tolerance = 4e-6 / std::fabs(direction[wall]) + 1e-6;
    EXPECT_LT(glm::length(hit.position - (origin + static_cast<float>(expected) * direction)), tolerance);
    EXPECT_NEAR(glm::length(hit.normal), 1.f, 1e-6f);
    EXPECT_LT(glm::dot(hit.normal, direction), 0.f) << "the normal looks back at the ray";
  }
}

/// Distance from `origin` to the plane of a triangle, in lengths of `direction`, by Cramer's rule.
long double distance_to_plane(const std::array<glm::vec3, 3>& corners, glm::vec3 origin, glm::vec3 direction) {
  using Vector = glm::vec<3, long double>;
  const Vector ab = Vector(corners[1]) - Vector(corners[0]), ac = Vector(corners[2]) - Vector(corners[0]);
  return glm::determinant(glm::mat<3, 3, long double>(Vector(corners[0]) - Vector(origin), ab, ac)) /
         glm::determinant(glm::mat<3, 3, long double>(Vector(direction), ab, ac));
}

// Triangles of any size, anywhere: half a unit in the last place of a float is 6e-8 of it.
TEST(EmbreeScene, DistancesAreTheNearestFloats) {
  int hits = 0;
  for (std::uint32_t i = 0; i < 2000; ++i) {
    const RandomStream random(3, Purpose::test, i);
    const auto drawn = [&](std::uint32_t item) {
      const auto u = random.uniform4(item);
      return 2.f * glm::vec3(u[0], u[1], u[2]) - 1.f;
    };
    const float size_m = std::pow(10.f, 4 * random.uniform(20) - 2), away_m = std::pow(10.f, 4 * random.uniform(24) - 1);
    const glm::vec3 centre = away_m * drawn(0);
    std::array<glm::vec3, 3> corners;
    for (std::uint32_t corner = 0; corner < 3; ++corner) corners[corner] = centre + size_m * drawn(4 + 4 * corner);
    const glm::vec3 inside = (corners[0] + corners[1] + corners[2]) / 3.f, origin = inside + 3 * size_m * drawn(16);
    const glm::vec3 direction = glm::normalize(inside - origin), normal = glm::cross(corners[1] - corners[0], corners[2] - corners[0]);
    const float length = glm::length(normal);
    if (!(length > 0.1f * size_m * size_m) || std::fabs(glm::dot(normal, direction)) < 0.1f * length) continue;  // grazing
    const EmbreeScene scene(corners, std::array{glm::uvec3(0, 1, 2)});
    const Hit hit = scene.intersect(origin, direction);
    if (!hit.valid()) continue;  // far away a small triangle has few floats
    ++hits;
    const auto expected = static_cast<double>(distance_to_plane(corners, origin, direction));
    EXPECT_NEAR(hit.distance_m, expected, 1e-7 * expected) << i;
    std::array<glm::vec3, 8> origins, along;
    origins.fill(origin);
    along.fill(direction);
    std::array<float, 8> by_eight;
    scene.intersect8(origins, along, by_eight);
    for (const float distance : by_eight) EXPECT_EQ(distance, hit.distance_m) << i;
  }
  EXPECT_GT(hits, 1000);
}

TEST(EmbreeScene, RaysAtOnceMatchSingleRays) {
  const EmbreeScene scene = build(tessellated_cube(7, 3, 0));
  for (std::uint32_t packet = 0; packet < 1000; ++packet) {
    const auto u = RandomStream(2, Purpose::test, packet).uniform4(0);
    const glm::vec3 origin = glm::vec3(u[0], u[1], u[2]) * 5.f - 1.f;  // some start outside and escape
    Directions16 directions;
    std::array<glm::vec3, 16> each;
    for (std::uint32_t lane = 0; lane < 16; ++lane) {
      each[lane] = uniform_direction(RandomStream(2, Purpose::test, packet, lane).uniform2(1));
      directions.x[lane] = each[lane].x;
      directions.y[lane] = each[lane].y;
      directions.z[lane] = each[lane].z;
    }
    std::array<float, 16> distances;
    std::array<Hit, 16> hits;
    scene.intersect16(origin, directions, distances);
    scene.intersect16(origin, directions, hits);
    std::array<glm::vec3, 8> origins;
    std::array<float, 8> by_eight;
    origins.fill(origin);
    for (std::size_t half = 0; half < 2; ++half) {
      scene.intersect8(origins, std::span(each).subspan(8 * half).first<8>(), by_eight);
      for (std::size_t lane = 0; lane < 8; ++lane) EXPECT_EQ(by_eight[lane], distances[8 * half + lane]);  // bits
    }
    for (std::size_t lane = 0; lane < 16; ++lane) {
      const Hit hit = scene.intersect(origin, each[lane]);
      EXPECT_EQ(hits[lane].distance_m, distances[lane]);  // bits
      EXPECT_EQ(hits[lane].valid(), hit.valid());
      if (!hit.valid()) {
        EXPECT_EQ(distances[lane], std::numeric_limits<float>::infinity());
      } else if (hits[lane].triangle == hit.triangle) {
        EXPECT_EQ(hits[lane].normal, hit.normal);
        EXPECT_EQ(hits[lane].position, hit.position);
        EXPECT_EQ(distances[lane], hit.distance_m);
      } else {  // the other side of an edge: a few units in the last place, 1 / cos longer at grazing rays
        EXPECT_NEAR(distances[lane], hit.distance_m,
                    1e-5f * (1 + hit.distance_m) / std::max(1e-2f, std::fabs(glm::dot(hit.normal, each[lane]))));
      }
    }
  }
}

TEST(EmbreeScene, EmptySceneLetsEveryRayEscape) {
  const EmbreeScene scene = build({});
  EXPECT_EQ(scene.num_triangles(), 0u);
  EXPECT_FALSE(scene.intersect({1, 2, 3}, {0, -1, 0}).valid());
  EXPECT_FALSE(scene.occluded({0, 0, 0}, {100, 0, 0}));
  std::array<glm::vec3, 8> origins{}, directions;
  directions.fill({0, 0, -1});
  std::array<float, 8> distances{};
  scene.intersect8(origins, directions, distances);
  for (const float distance : distances) EXPECT_EQ(distance, std::numeric_limits<float>::infinity());
}

// A segment is blocked by a rectangle exactly if it crosses the plane inside it; both directions agree bit for bit.
TEST(EmbreeScene, OcclusionIsTrueAndSymmetric) {
  Soup soup;
  append_rectangle(soup, -1, -1, 1, 1, 0.5f);
  const EmbreeScene scene = build(soup);
  int blocked = 0;
  for (std::uint32_t i = 0; i < 50'000; ++i) {
    const RandomStream random(3, Purpose::test, i);
    const auto u = random.uniform4(0), v = random.uniform4(1);
    const glm::vec3 a(4 * u[0] - 2, 2 * u[1] - 0.5f, 4 * u[2] - 2), b(4 * v[0] - 2, 2 * v[1] - 0.5f, 4 * v[2] - 2);
    const bool is_blocked = scene.occluded(a, b);
    ASSERT_EQ(is_blocked, scene.occluded(b, a));
    const double fraction = (0.5 - a.y) / (static_cast<double>(b.y) - a.y);
    const double x = a.x + fraction * (static_cast<double>(b.x) - a.x), z = a.z + fraction * (static_cast<double>(b.z) - a.z);
    const double inside = std::min(1 - std::fabs(x), 1 - std::fabs(z));
    if (std::fabs(inside) < 1e-4 || fraction < 1e-4 || fraction > 1 - 1e-4) continue;  // the border is either
    EXPECT_EQ(is_blocked, fraction > 0 && fraction < 1 && inside > 0) << i;
    blocked += is_blocked;
  }
  EXPECT_GT(blocked, 1000);
  EXPECT_FALSE(scene.occluded({0, 0.5f, 0}, {0, 0.5f, 0})) << "a segment without length";
}

TEST(EmbreeScene, SegmentsEndAtSurfacesWithoutSeeingThem) {
  const EmbreeScene scene = build(tessellated_cube(8, 10, 0));
  for (std::uint32_t i = 0; i < 20'000; ++i) {
    const RandomStream random(4, Purpose::test, i);
    const glm::vec3 centre(3, 4, 5);
    const Hit hit = scene.intersect(centre, uniform_direction(random.uniform2(0)));
    ASSERT_TRUE(hit.valid());
    EXPECT_FALSE(scene.occluded(centre, offset_from_surface(hit.position, hit.normal)));
    EXPECT_TRUE(scene.occluded(centre, hit.position - 0.01f * hit.normal));
  }
}

// docs/evidence/stability.md, H-6: coplanar overlapping triangles give the lowest id, whatever the direction of the ray.
TEST(EmbreeScene, CoplanarTrianglesGiveTheLowestId) {
  for (const float height : {0.f, 0.3f, 777.7f}) {
    Soup soup;
    append_rectangle(soup, -3, -2.5f, 3, 2.5f, height);        // triangles 0, 1
    append_rectangle(soup, -2.9f, -2.7f, 3.1f, 2.6f, height);  // 2, 3: other diagonals and edges
    append_rectangle(soup, -5, -5, 5, 5, height);              // 4, 5
    // Enough others that the tree puts the coplanar ones into different leaves.
    for (int i = 0; i < 400; ++i) append_rectangle(soup, -4, -4, -3.9f, -3.9f, height - 50.f - static_cast<float>(i));
    const EmbreeScene scene = build(soup);
    for (std::uint32_t i = 0; i < 20'000; ++i) {
      const RandomStream random(5, Purpose::test, i);
      const auto u = random.uniform4(0);
      const float side = i % 2 ? 1.f : -1.f;
      const glm::vec3 target(4 * u[0] - 2, height, 4 * u[1] - 2), origin(20 * u[2] - 10, height + side * (0.05f + 3 * u[3]), 1);
      const Hit hit = scene.intersect(origin, glm::normalize(target - origin));
      ASSERT_TRUE(hit.valid());
      EXPECT_LE(hit.triangle, 1u) << "height " << height << ", ray " << i;
    }
  }
}

TEST(EmbreeScene, AHitOnOtherTrianglesNamesTheOneTheyStandFor) {
  const std::vector<glm::vec3> vertices = {{0, 0, 0}, {4, 0, 0}, {4, 0, 4}, {0, 0, 4}, {0, 1, 0}, {4, 1, 0}, {4, 1, 4}};
  const std::vector<glm::uvec3> traced = {{0, 1, 2}, {0, 2, 3}, {4, 5, 6}};
  const std::vector<std::uint32_t> stands_for = {7, 7, 19};
  const EmbreeScene scene(vertices, traced, stands_for);
  EXPECT_EQ(scene.num_triangles(), 3u);
  EXPECT_EQ(scene.intersect({1, 0.5f, 2}, {0, -1, 0}).triangle, 7u);
  EXPECT_EQ(scene.intersect({2, 0.5f, 1}, {0, -1, 0}).triangle, 7u);
  const Hit above = scene.intersect({2, 0.5f, 1}, {0, 1, 0});
  EXPECT_EQ(above.triangle, 19u);
  EXPECT_EQ(above.normal, glm::vec3(0, -1, 0));
}

TEST(EmbreeScene, NearerParallelSurfaceWinsWhateverItsId) {
  Soup soup;
  append_rectangle(soup, -1, -1, 1, 1, 0);
  append_rectangle(soup, -1, -1, 1, 1, 0.001f);  // a poster a millimetre in front of the wall
  const EmbreeScene scene = build(soup);
  EXPECT_GE(scene.intersect({0.1f, 3, 0.2f}, {0, -1, 0}).triangle, 2u);
  EXPECT_LE(scene.intersect({0.1f, -3, 0.2f}, {0, 1, 0}).triangle, 1u);
}

TEST(EmbreeScene, HitsLieBeforeTheMaximumDistance) {
  Soup soup;
  append_rectangle(soup, -1, -1, 1, 1, 0);
  const EmbreeScene scene = build(soup);
  EXPECT_FALSE(scene.intersect({0.1f, 2, 0.2f}, {0, -1, 0}, 1.99f).valid());
  const Hit hit = scene.intersect({0.1f, 2, 0.2f}, {0, -1, 0}, 2.01f);
  ASSERT_TRUE(hit.valid());
  EXPECT_FLOAT_EQ(hit.distance_m, 2);
}

// docs/evidence/stability.md, H-1, H-2: neither a triangle without area nor a needle gives a normal that is not a number.
TEST(EmbreeScene, DegenerateTrianglesGiveFiniteHits) {
  Soup soup;
  append_rectangle(soup, -1, -1, 1, 1, 0);
  soup.vertices.insert(soup.vertices.end(), {{0, 0, 0}, {1, 0, 0}, {0.5f, 1e-7f, 0}, {0, 0, 0}});
  soup.triangles.emplace_back(4, 5, 6);
  soup.triangles.emplace_back(4, 7, 5);
  soup.triangles.emplace_back(4, 4, 4);
  const EmbreeScene scene = build(soup);
  for (std::uint32_t i = 0; i < 20'000; ++i) {
    const RandomStream random(6, Purpose::test, i);
    const auto u = random.uniform4(0);
    const glm::vec3 origin(u[0], u[1] - 0.5f, 2 * u[2] - 1), target(u[3], 0, 0);
    const Hit hit = scene.intersect(origin, glm::normalize(target - origin));
    if (!hit.valid()) continue;
    EXPECT_TRUE(std::isfinite(hit.distance_m) && std::isfinite(hit.position.x + hit.position.y + hit.position.z));
    EXPECT_NEAR(glm::length(hit.normal), 1, 1e-5f);
  }
}

TEST(EmbreeScene, MovesAndOutlivesItsInput) {
  EmbreeScene scene = build(tessellated_cube(2, 1, 0));
  EmbreeScene moved = std::move(scene);
  scene = build(tessellated_cube(2, 8, 0));
  EXPECT_NEAR(moved.intersect(glm::vec3(0.5f), {1, 0, 0}).distance_m, 0.5f, 1e-6f);
  EXPECT_NEAR(scene.intersect(glm::vec3(0.5f), {1, 0, 0}).distance_m, 7.5f, 1e-5f);
}

// Waechter and Binder: 1/65536 near the origin, else 256 units in the last place; always along the normal.
TEST(OffsetFromSurface, MovesByTheScaleOfThePosition) {
  EXPECT_FLOAT_EQ(offset_from_surface({0, 0, 0}, {0, 1, 0}).y, 1.f / 65536);
  EXPECT_EQ(offset_from_surface({0, 0, 0}, {0, 1, 0}).x, 0);
  for (const float position : {0.5f, 10.f, -10.f, 1e4f, -1e6f}) {
    for (const float normal : {1.f, -1.f}) {
      const float moved = offset_from_surface({position, 0, 0}, {normal, 0, 0}).x - position;
      const float ulp = std::nextafter(std::fabs(position), 2e9f) - std::fabs(position);
      EXPECT_GT(moved * normal, 0) << position;
      EXPECT_NEAR(std::fabs(moved), 256 * ulp, 129 * ulp) << position << ": half below a power of two";
    }
  }
}

// A guess of what blocks a segment saves time and changes no answer, right or wrong, near the sides of triangles and with ends on them.
TEST(EmbreeScene, AGuessedBlockerChangesNoAnswer) {
  std::vector<glm::vec3> vertices;
  std::vector<glm::uvec3> triangles;
  const auto random = [](std::uint32_t a, std::uint32_t b) { return RandomStream(5, Purpose::test, a).uniform4(b); };
  for (std::uint32_t i = 0; i < 60; ++i) {
    for (std::uint32_t corner = 0; corner < 3; ++corner) {
      const auto u = random(i, corner);
      // On a coarse lattice, so that segments meet sides, corners and each other's planes.
      vertices.emplace_back(std::round(8 * u[0]), std::round(8 * u[1]), std::round(8 * u[2]));
    }
    triangles.emplace_back(3 * i, 3 * i + 1, 3 * i + 2);
  }
  const EmbreeScene scene(vertices, triangles);
  int blocked = 0, kept = 0;
  for (std::uint32_t i = 0; i < 20'000; ++i) {
    const auto u = random(1000, 2 * i), v = random(1000, 2 * i + 1);
    const float scale = i % 2 == 0 ? 1.f : 4.f;  // half of the ends lie on the lattice of quarters
    const auto end = [&](float x, float y, float z) {
      return i % 2 == 0 ? 8.f * glm::vec3(x, y, z)
                        : glm::vec3(std::round(8 * x * scale), std::round(8 * y * scale), std::round(8 * z * scale)) / scale;
    };
    const glm::vec3 from = end(u[0], u[1], u[2]), to = end(v[0], v[1], v[2]);
    const bool expected = scene.occluded(from, to);
    std::uint32_t blocker = static_cast<std::uint32_t>(u[3] * 60);
    EXPECT_EQ(scene.occluded(from, to, blocker), expected);
    blocked += expected ? 1 : 0;
    if (expected) {
      EXPECT_LT(blocker, 60u);
      const std::uint32_t known = blocker;
      EXPECT_TRUE(scene.occluded(to, from, blocker));
      kept += blocker == known ? 1 : 0;
    }
    std::uint32_t no_blocker = Hit::no_triangle;
    EXPECT_EQ(scene.occluded(from, to, no_blocker), expected);
    for (std::uint32_t wrong = i % 7; wrong < 60; wrong += 7) {
      std::uint32_t guess = wrong;
      EXPECT_EQ(scene.occluded(from, to, guess), expected) << wrong;
    }
  }
  EXPECT_GT(blocked, 4000);
  EXPECT_LT(blocked, 19'000);
  EXPECT_GT(kept, blocked / 2);
}

}  // namespace
}  // namespace earshot
