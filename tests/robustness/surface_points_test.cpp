// SPDX-License-Identifier: Apache-2.0
// Sources and listeners exactly on walls, edges and corners (docs/evidence/stability.md, H-16), and rays that start there (H-17).

#include <gtest/gtest.h>

#include <cmath>
#include <glm/geometric.hpp>

#include "sim/acoustics/paths/transmission.h"
#include "sim/acoustics/response/energy_response.h"
#include "tests/support/acoustics/rooms.h"
#include "tests/support/files/mesh_cases.h"

namespace earshot {
namespace {

using namespace mesh_cases;

/// Places of the 5 x 3 x 4 m box: on a wall, inside a triangle and on its diagonal; on an edge; in a corner.  `inward`: sum of the normals
/// there.
struct Place {
  const char* name;
  glm::vec3 point, inward;
};
const std::array<Place, 5> kPlaces = {{{"floor", {1.25f, 0, 3.f}, {0, 1, 0}},
                                       {"diagonal", {2.5f, 0, 2}, {0, 1, 0}},
                                       {"wall", {0, 1.1f, 1.7f}, {1, 0, 0}},
                                       {"edge", {1.7f, 0, 0}, {0, 1, 1}},
                                       {"corner", {0, 0, 0}, {1, 1, 1}}}};

// A ray into the room sees the opposite walls at the slab distance: no hit at distance zero.
TEST(H16_OnASurface, RaysIntoTheRoomDoNotSeeWhereTheyStart) {
  const auto scene = scene_of(box({5, 3, 4}));
  for (const Place& place : kPlaces) {
    for (std::uint32_t i = 0; i < 20'000; ++i) {
      glm::vec3 direction = random_direction(i, 21);
      for (int axis = 0; axis < 3; ++axis)
        if (place.inward[axis] > 0) direction[axis] = std::max(std::fabs(direction[axis]), 1e-3f);
      direction = glm::normalize(direction);
      double expected_m = 1e9;
      for (int axis = 0; axis < 3; ++axis) {
        const double size = glm::vec3(5, 3, 4)[axis], d = direction[axis], p = place.point[axis];
        if (d > 0) expected_m = std::min(expected_m, (size - p) / d);
        if (d < 0) expected_m = std::min(expected_m, -p / d);
      }
      const Hit hit = scene->rays().intersect(place.point, direction);
      ASSERT_TRUE(hit.valid()) << place.name;
      ASSERT_NEAR(hit.distance_m, expected_m, 1e-5 * expected_m) << place.name << " ray " << i;
    }
  }
}

TEST(H16_OnASurface, SegmentsFromASurfaceAreFree) {
  const auto scene = scene_of(box({5, 3, 4}));
  const glm::vec3 inside(2.2f, 1.3f, 1.9f);
  for (const Place& place : kPlaces) {
    EXPECT_FALSE(scene->rays().occluded(place.point, inside)) << place.name;
    EXPECT_FALSE(scene->rays().occluded(inside, place.point)) << place.name;
    EXPECT_TRUE(scene->rays().occluded(place.point - 0.01f * place.inward, inside)) << place.name << ", from behind the wall";
    for (const Place& other : kPlaces) {
      if (glm::dot(place.inward, other.inward) > 0) continue;  // in one plane: the segment runs along the wall
      EXPECT_FALSE(scene->rays().occluded(place.point, other.point)) << place.name << " to " << other.name;
    }
  }
}

constexpr int kRays = 20'000;

EnergyResponse respond(glm::vec3 source, glm::vec3 listener) {
  AcousticConfig config;
  config.rays = kRays;
  config.bands = 1;
  config.air_absorption = Switch::off;
  config.diffraction = Switch::off;
  const AcousticScene acoustics(scene_of(box({5, 3, 4}), 0.3f, 1.f), config);
  EnergyResponse response;
  compute_energy_response(acoustics, EarlyCandidates(acoustics, source), listener, response);
  return response;
}

double late_energy(const EnergyResponse& response) {
  double sum = 0;
  for (const double energy : response.late.band_energy(0)) sum += energy;
  return sum;
}

// The direct sound is there, and the late field is that of the half-space, of the quarter or of the eighth: rays into the wall leave.
// (A rounding before the wall they would come back at once, lit by the source.)
TEST(H16_OnASurface, ResponseIsThatOfTheSpaceBeforeIt) {
  const glm::vec3 other(2.2f, 1.3f, 1.9f);
  for (const Place& place : kPlaces) {
    const EnergyResponse forward = respond(other, place.point), backward = respond(place.point, other);
    for (const EnergyResponse* response : {&forward, &backward}) {
      ASSERT_FALSE(response->arrivals.empty()) << place.name;
      ASSERT_EQ(response->arrivals[0].kind, ArrivalKind::direct) << place.name;
      const double r = glm::length(other - place.point);
      EXPECT_NEAR(response->arrivals[0].amplitude[0] * 4 * 3.14159265358979 * r, 1, 1e-5) << place.name;
    }
    const double walls = place.inward.x + place.inward.y + place.inward.z, inside = std::exp2(-walls);
    // Of all rays the fraction outside leaves with its first segment; nothing else does.  Four sigma.
    EXPECT_NEAR(static_cast<double>(forward.stats.ray_escapes) / kRays, 1 - inside, 4 * std::sqrt(inside * (1 - inside) / kRays))
        << place.name;
    EXPECT_EQ(backward.stats.ray_escapes, 0u) << place.name;
    // Sound goes both ways alike (O-17), and the two are found by different rays: 2 % of noise each.
    ASSERT_GT(late_energy(backward), 0) << place.name;
    if (walls == 1) {
      EXPECT_NEAR(late_energy(forward) / late_energy(backward), 1, 0.1) << place.name;
    }
  }
}

// Behind a sheet, on the wall beyond it: sound passes the sheet, not the wall that the place is before.  From both ends of each axis.
TEST(H16_OnASurface, TheWallOfThePlaceItselfIsNotPassed) {
  using rooms::point;
  TriangleMesh mesh;
  rooms::append_box(mesh, {0, 0, 0}, {5, 4, 3}, 0);
  rooms::append_quad(mesh, {point(2, 0, 0), point(2, 4, 0), point(2, 4, 3), point(2, 0, 3)}, 0);
  Material wall = Material::uniform("wall", 0.3f, 1.f);
  wall.transmission = CoefficientCurve::constant(0.1f);
  AcousticConfig config;
  config.diffraction = Switch::off;
  const AcousticScene acoustics(rooms::scene_of(mesh, {wall}), config);
  const glm::vec3 other = point(1, 1.3, 1.9);
  for (const glm::vec3 place : {point(5, 1.1, 1.7), point(4, 4, 1.7), point(4, 0, 1.7), point(4, 1.1, 3), point(4, 1.1, 0)}) {
    for (const bool back : {false, true}) {
      std::vector<Arrival> arrivals;
      find_transmitted(acoustics, back ? place : other, back ? other : place, arrivals);
      ASSERT_EQ(arrivals.size(), 1u) << place.x << ' ' << place.y << ' ' << place.z;
      EXPECT_EQ(arrivals[0].order, 1) << place.x << ' ' << place.y << ' ' << place.z;
    }
  }
}

// On a sheet in the open, from its two sides: what stands on it hears a source above and a source below alike.
TEST(H16_OnASurface, BothSidesOfASheetAreAlike) {
  TriangleMesh mesh;
  mesh.vertices = {{-2, 0, -2}, {2, 0, -2}, {2, 0, 2}, {-2, 0, 2}};
  mesh.triangles = {{0, 2, 1}, {0, 3, 2}};
  const auto scene = scene_of(mesh, 0.3f, 0.f);
  AcousticConfig config;
  config.bands = 1;
  config.air_absorption = Switch::off;
  config.diffraction = Switch::off;
  const AcousticScene acoustics(scene, config);
  EnergyResponse above, below;
  compute_energy_response(acoustics, EarlyCandidates(acoustics, glm::vec3(0.5f, 1, 0.3f)), {0.2f, 0, 0.1f}, above);
  compute_energy_response(acoustics, EarlyCandidates(acoustics, glm::vec3(0.5f, -1, 0.3f)), {0.2f, 0, 0.1f}, below);
  ASSERT_EQ(above.arrivals.size(), below.arrivals.size());
  ASSERT_FALSE(above.arrivals.empty());
  for (std::size_t i = 0; i < above.arrivals.size(); ++i)
    EXPECT_NEAR(above.arrivals[i].amplitude[0] / below.arrivals[i].amplitude[0], 1, 1e-3);
}

}  // namespace
}  // namespace earshot
