// SPDX-License-Identifier: Apache-2.0
#include "sim/acoustics/source_field/photon_rooms.h"

#include <gtest/gtest.h>

#include <glm/geometric.hpp>

#include "sim/acoustics/core/sampling.h"
#include "sim/base/random.h"
#include "tests/support/acoustics/effect_scenes.h"

namespace earshot {
namespace {

using rooms::point;

struct Photon : listener_ray::RayState<8> {
  std::uint32_t cell = FieldGrid::no_cell, room = FieldGrid::no_room;
  std::uint64_t visited = 0;
};
using Rooms = PhotonRooms<8, Photon>;

AcousticConfig with_transmission() {
  AcousticConfig config = rooms::plain_config();
  config.transmission = Switch::on;
  config.bands = 7;
  return config;
}

/// Two closed rooms of 4 m with a wall of a drawn transmittance between them, and a photon in the first, at that wall.
struct TwoRooms {
  static constexpr double kAbsorption = 0.5;
  RandomStream random;
  double tau;
  AcousticScene scene;
  glm::vec3 source = point(1, 2, 1.5);
  EarlyCandidates candidates;
  listener_ray::Trace trace;
  const FieldGrid& grid;
  std::uint32_t here, beyond;

  explicit TwoRooms(std::uint32_t number)
      : random(562, Purpose::test, number),
        tau(0.01 + 0.4 * double{random.uniform(0)}),
        scene(effects::two_rooms(8, 4, 3, 0, effects::material(0.3, 0.5, 0.1), effects::material(kAbsorption, 0.5, tau)),
              with_transmission()),
        candidates(scene, source),
        trace{.scene = scene,
              .candidates = candidates,
              .emission = nullptr,
              .walls = &scene.reflection_model(),
              .source = source,
              .listener = {},
              .directions = {1, 2},
              .num_rays = 1,
              .max_bounces = 100,
              .carried_order = 0,
              .sh_order = 0,
              .num_coefficients = 0,
              .weight_per_ray = 1,
              .max_path_m = scene.max_path_m(),
              .seconds_per_m = 1 / 343.f,
              .stage_m = 1,
              .least_distance2_m2 = 0,
              .source_radius_m = 1,
              .source_spread_m = 0,
              .diffuse_last_segment = false},
        grid(scene.field_grid()),
        here(room_at(source)),
        beyond(room_at(point(6, 2, 1.5))) {}

  [[nodiscard]] std::uint32_t room_at(glm::vec3 place) const {
    std::array<FieldGrid::CellWeight, 8> shares;
    return grid.blend(place, shares) > 0 ? grid.room(shares[0].cell) : FieldGrid::no_room;
  }
  [[nodiscard]] std::uint32_t material_of(const Photon& photon) const {
    return scene.scene().mesh().triangle_material[photon.hit.triangle];
  }
  /// A photon of energy 1 that came from the source to a drawn point of x = x_m.
  [[nodiscard]] Photon at_wall(double x_m) const {
    Photon photon;
    photon.direction = glm::normalize(point(x_m, 0.5 + 3 * double{random.uniform(1)}, 0.5 + 2 * double{random.uniform(2)}) - source);
    photon.hit = scene.scene().rays().intersect(source, photon.direction);
    const float* kept = scene.reflection_model().kept(material_of(photon));
    for (int b = 0; b < 8; ++b) {
      photon.throughput[b] = photon.weight[b] = b < scene.num_bands() ? 1.f : 0.f;
      photon.reflected[b] = photon.throughput[b] * kept[b];
      photon.arriving[b] = 0;
    }
    photon.origin = offset_from_surface(photon.hit.position, photon.hit.normal);
    photon.at_vertex = true;
    photon.bounces = 1;
    photon.room = here;
    photon.visited = Rooms::bit_of(here);
    return photon;
  }
};

// What goes through is tau of what came, and what stays 1 - absorption: single precision.
TEST(PhotonRooms, PartsWhatTheWallLetsThrough) {
  for (std::uint32_t number = 0; number < 10; ++number) {
    const TwoRooms two(number);
    ASSERT_EQ(two.grid.num_rooms(), 2u);
    ASSERT_NE(two.here, two.beyond);
    Rooms rooms(two.trace, two.grid, two.here, 64);
    Photon photon = two.at_wall(4);
    ASSERT_TRUE(rooms.part(photon, two.material_of(photon))) << number;
    const std::vector<Photon> entered = rooms.take_entered();
    ASSERT_EQ(entered.size(), 1u);
    EXPECT_EQ(entered[0].room, two.beyond);
    EXPECT_EQ(entered[0].visited, Rooms::bit_of(two.here) | Rooms::bit_of(two.beyond));
    for (int b = 0; b < two.scene.num_bands(); ++b) {
      EXPECT_NEAR(double{entered[0].throughput[b]}, two.tau, 1e-5 * two.tau);
      EXPECT_NEAR(double{photon.reflected[b]}, 1 - TwoRooms::kAbsorption, 1e-5);
    }
    EXPECT_TRUE(rooms.take_entered().empty());
  }
}

// By chance, which leave_vertex() takes care of: the photon keeps all it has, and no other is made.
TEST(PhotonRooms, LeavesToChanceWhereNoRoomIsNew) {
  for (std::uint32_t number = 0; number < 10; ++number) {
    const TwoRooms two(number);
    Rooms rooms(two.trace, two.grid, two.here, 64);
    const auto expect_whole = [&](Photon photon, const char* why) {
      const Photon before = photon;
      EXPECT_FALSE(rooms.part(photon, two.material_of(photon))) << why << " " << number;
      EXPECT_TRUE(rooms.take_entered().empty()) << why << " " << number;
      for (int b = 0; b < two.scene.num_bands(); ++b) EXPECT_EQ(photon.reflected[b], before.reflected[b]) << why;
      EXPECT_EQ(photon.visited, before.visited) << why;
    };
    Photon traveller = two.at_wall(4);
    traveller.visited |= Rooms::bit_of(two.beyond);
    expect_whole(traveller, "it has been in every room");
    Photon stray = two.at_wall(4);
    stray.room = FieldGrid::no_room;
    expect_whole(stray, "its room is not known");
    expect_whole(two.at_wall(0), "the wall leads into the open");
    // One that has been in the room beyond but not in its own, as one that started in a gap: no way back is parted either.
    Photon returned = two.at_wall(4);
    returned.visited = Rooms::bit_of(two.beyond);
    expect_whole(returned, "it has been in the room beyond");
  }
}

// 2048 halves in a stage, all others go by chance.
TEST(PhotonRooms, PartsNoMoreThanItsLimit) {
  const TwoRooms two(3);
  Rooms rooms(two.trace, two.grid, two.here, 64);
  int parted = 0;
  for (int i = 0; i < 3000; ++i) {
    Photon photon = two.at_wall(4);
    parted += rooms.part(photon, two.material_of(photon));
    const bool whole = photon.reflected[0] == two.at_wall(4).reflected[0];
    EXPECT_EQ(whole, i >= 2048) << i;
  }
  EXPECT_EQ(parted, 2048);
  EXPECT_EQ(rooms.take_entered().size(), 2048u);
  Photon photon = two.at_wall(4);
  EXPECT_TRUE(rooms.part(photon, two.material_of(photon))) << "the next stage begins anew";
}

// Nothing goes through with no energy; the photon stays in its room as one whose other half has gone.
TEST(PhotonRooms, MakesNoPhotonOfNothing) {
  for (std::uint32_t number = 0; number < 10; ++number) {
    const TwoRooms two(number);
    Rooms rooms(two.trace, two.grid, two.here, 64);
    Photon photon = two.at_wall(4);
    for (float& energy : photon.reflected) energy = 0;
    EXPECT_TRUE(rooms.part(photon, two.material_of(photon)));
    EXPECT_TRUE(rooms.take_entered().empty());
  }
}

}  // namespace
}  // namespace earshot
