// SPDX-License-Identifier: Apache-2.0
#include "sim/acoustics/paths/early_reflections.h"

#include <gtest/gtest.h>

#include <cmath>
#include <glm/geometric.hpp>
#include <numbers>

#include "tests/support/acoustics/rooms.h"

namespace earshot {
namespace {

struct Shoe1Row {
  double distance_m;
  int order;
  glm::dvec3 direction;  // oracle axes
  double amplitude, rigid_amplitude;
};
// docs/evidence/oracles.md, O-2, with all digits.
const Shoe1Row kShoe1[] = {
    {2.76586333719, 0, {-0.940032, -0.289241, -0.180775}, 0.02877129556, 0.02877129556},
    {3.83275357935, 1, {-0.678363, -0.208727, -0.704454}, 0.01857052713, 0.02076248052},
    {4.27668095607, 1, {-0.607948, -0.187061, 0.771626}, 0.01664287214, 0.01860729672},
    {4.63141447076, 1, {-0.561384, -0.820484, -0.107958}, 0.01536814612, 0.01718210971},
    {4.96487663492, 1, {-0.523679, 0.845942, -0.100707}, 0.01433595627, 0.01602808638},
    {5.08822169328, 1, {-0.982662, -0.157226, -0.098266}, 0.0139884342, 0.01563954488},
    {5.08822169328, 1, {0.982662, -0.157226, -0.098266}, 0.0139884342, 0.01563954488},
    {5.33760245803, 2, {-0.487110, -0.711930, -0.505845}, 0.01192707358, 0.01490884197},
    {5.62938717802, 2, {-0.461862, 0.746085, -0.479626}, 0.01130886458, 0.01413608072},
    {5.66480361531, 2, {-0.458974, -0.670809, 0.582544}, 0.01123816138, 0.01404770173},
    {5.73846669416, 2, {-0.871313, -0.139410, -0.470509}, 0.01109390028, 0.01386737534},
    {5.73846669416, 2, {0.871313, -0.139410, -0.470509}, 0.01109390028, 0.01386737534},
    {5.94053869611, 2, {-0.437671, 0.707007, 0.555505}, 0.01071653271, 0.01339566588},
    {6.0440052945, 2, {-0.827266, -0.132363, 0.545996}, 0.01053307768, 0.01316634709},
    {6.0440052945, 2, {0.827266, -0.132363, 0.545996}, 0.01053307768, 0.01316634709},
    {6.13595958266, 2, {-0.423732, -0.130379, 0.896355}, 0.0103752276, 0.0129690345},
    {6.3, 2, {-0.793651, -0.603175, -0.079365}, 0.01010507575, 0.01263134469},
    {6.3, 2, {0.793651, -0.603175, -0.079365}, 0.01010507575, 0.01263134469},
    {6.54904573201, 2, {-0.763470, 0.641315, -0.076347}, 0.009720802059, 0.01215100257},
    {6.54904573201, 2, {0.763470, 0.641315, -0.076347}, 0.009720802059, 0.01215100257},
};

struct Shoe2Row {
  double distance_m;
  int order;
  double amplitude[6];  // 125 Hz ... 4 kHz
};
// docs/evidence/oracles.md, O-3.
const Shoe2Row kShoe2[] = {
    {4.33704968844, 0, {0.01834829602, 0.01834829602, 0.01834829602, 0.01834829602, 0.01834829602, 0.01834829602}},
    {5.1, 1, {0.01496628026, 0.01360275124, 0.01023185054, 0.008687619807, 0.008402701945, 0.008107777874}},
    {6.1, 1, {0.00922455242, 0.007145307579, 0.008250690509, 0.007145307579, 0.007145307579, 0.00922455242}},
    {6.83300812234, 1, {0.009813125959, 0.01104840164, 0.01135115363, 0.01141074015, 0.01123103222, 0.01110961209}},
    {7.17565328036, 1, {0.009344538645, 0.01052082859, 0.01080912384, 0.01086586504, 0.01069473836, 0.01057911617}},
    {7.34098086089, 2, {0.008761109981, 0.008965284897, 0.006928385987, 0.005913607658, 0.00562958677, 0.005373269487}},
    {7.66093989012, 2, {0.008395202366, 0.00859084992, 0.006639022059, 0.005666625931, 0.005394467171, 0.005148854975}},
    {7.97558775264, 2, {0.006767158584, 0.0047642535, 0.004138011199, 0.003042768506, 0.002942978332, 0.003666015716}},
    {7.97558775264, 1, {0.009877350749, 0.009877350749, 0.009826826885, 0.00977604191, 0.009724991733, 0.009622078872}},
    {8.06783738061, 2, {0.005876884787, 0.00512524797, 0.006080297071, 0.005293333342, 0.005209968552, 0.006653324391}},
    {8.36002392341, 2, {0.005671485058, 0.004946118281, 0.005867787992, 0.005108328995, 0.005027877841, 0.006420787754}},
    {8.41486779456, 2, {0.008979451112, 0.008161362586, 0.006107492379, 0.005158926046, 0.004963678456, 0.004738776162}},
    {8.48587060943, 2, {0.006360227443, 0.004477763522, 0.003889179196, 0.00285979699, 0.002766007522, 0.003445566329}},
    {8.7412813706, 1, {0.00733958855, 0.007883982795, 0.008243695891, 0.008539970534, 0.008779231688, 0.008919708315}},
    {9.05593727893, 2, {0.006151128079, 0.004764643322, 0.005473594152, 0.004715773894, 0.004691148274, 0.005992157313}},
    {9.14385039248, 2, {0.006729946569, 0.006570500491, 0.005167758122, 0.004545516172, 0.004519615584, 0.004430763025}},
    {9.5650405122, 3, {0.004754571824, 0.003768703755, 0.003363019212, 0.002485881446, 0.002366488633, 0.002916022714}},
    {9.5650405122, 2, {0.006939777306, 0.00781335604, 0.007986398784, 0.007986832109, 0.007819997228, 0.007653595271}},
    {9.73704267219, 2, {0.004659129086, 0.003876629727, 0.004680583362, 0.004199185171, 0.004316832169, 0.00566218013}},
    {9.81274681218, 3, {0.00463455065, 0.003673569163, 0.003278125444, 0.002423129548, 0.002306750605, 0.002842412622}},
};

AcousticConfig early_config(int order) {
  AcousticConfig config = rooms::plain_config();
  config.early = Switch::automatic;
  config.early_order = order;
  return config;
}

std::vector<Arrival> arrivals_in(const AcousticScene& scene, glm::vec3 source, glm::vec3 listener) {
  std::vector<Arrival> arrivals;
  EarlyCandidates(scene, source).find_arrivals(scene, listener, arrivals);
  return arrivals;
}

TEST(DirectSound, FreeFieldO1) {
  const AcousticScene scene(rooms::empty(), early_config(2));
  const double distance_m[] = {0.5, 1, 2, 3.43, 5, 10, 34.3, 100};
  const double amplitude[] = {0.1591549, 0.07957747, 0.03978874, 0.02320043, 0.01591549, 0.007957747, 0.002320043, 7.957747e-04};
  const double delay_ms[] = {1.457726, 2.915452, 5.830904, 10, 14.57726, 29.15452, 100, 291.5452};
  for (int i = 0; i < 8; ++i) {
    const auto arrivals = arrivals_in(scene, {static_cast<float>(distance_m[i]), 1, 1}, {0, 1, 1});
    ASSERT_EQ(arrivals.size(), 1u);
    EXPECT_NEAR(arrivals[0].amplitude[0], amplitude[i], 1e-6 * amplitude[i]);
    EXPECT_NEAR(1e3 * arrivals[0].distance_m / scene.speed_of_sound_m_per_s(), delay_ms[i], 1e-6 * delay_ms[i]);
    EXPECT_EQ(arrivals[0].order, 0);
    EXPECT_EQ(arrivals[0].direction, glm::vec3(1, 0, 0));
  }
}

TEST(DirectSound, AirAbsorbsAlongThePath) {
  AcousticConfig config = early_config(0);
  config.bands = 0;
  config.low_octave = true;
  config.sample_rate_hz = 48000;
  config.air_absorption = Switch::on;
  Air air = rooms::oracle_air();
  const AcousticScene scene(rooms::scene_of({}, {}, air), config);
  const auto arrivals = arrivals_in(scene, {100, 0, 0}, {0, 0, 0});
  ASSERT_EQ(arrivals.size(), 1u);
  // docs/evidence/oracles.md, O-23, 20 C 50 %, exact midbands: dB per km, over 100 m.
  const double db_per_km[] = {0.12281, 0.44535, 1.318, 2.7335, 4.6647, 9.8552, 29.419, 103.91, 358.757};
  for (int b = 0; b < 9; ++b) {
    const double loss_db = -20 * std::log10(arrivals[0].amplitude[b] * 4 * std::numbers::pi * 100);
    EXPECT_NEAR(loss_db, 0.1 * db_per_km[b], 1e-3 * 0.1 * db_per_km[b] + 2e-6) << b;
  }
}

TEST(DirectSound, SourceAtListenerH13H14) {
  const AcousticScene scene(rooms::empty(), early_config(0));
  const auto same = arrivals_in(scene, {1, 2, 3}, {1, 2, 3});
  ASSERT_EQ(same.size(), 1u);
  EXPECT_NEAR(same[0].amplitude[0], 1 / (4 * std::numbers::pi * 0.01), 1e-5);
  EXPECT_EQ(same[0].direction, glm::vec3(0, 0, -1));
  const auto near = arrivals_in(scene, {1e-9f, 0, 0}, {0, 0, 0});
  ASSERT_EQ(near.size(), 1u);
  EXPECT_EQ(near[0].amplitude[0], same[0].amplitude[0]);
  EXPECT_NEAR(glm::length(near[0].direction), 1.f, 1e-6f);
}

TEST(DirectSound, OccludedOrTooLateH32) {
  TriangleMesh mesh;
  rooms::append_quad(mesh, {glm::vec3(1, -1, -1), {1, 1, -1}, {1, 1, 1}, {1, -1, 1}}, 0);
  const AcousticScene wall(rooms::scene_of(mesh, {Material::uniform("wall", 1.f, 0.f)}), early_config(1));
  EXPECT_TRUE(arrivals_in(wall, {2, 0, 0}, {0, 0, 0}).empty());
  EXPECT_EQ(arrivals_in(wall, {2, 0, 0}, {2, 0, 5}).size(), 1u);
  const AcousticScene open(rooms::empty(), early_config(1));  // 0.5 s is 171.5 m
  EXPECT_EQ(arrivals_in(open, {171, 0, 0}, {0, 0, 0}).size(), 1u);
  EXPECT_TRUE(arrivals_in(open, {172, 0, 0}, {0, 0, 0}).empty());
}

TEST(ImagePaths, Shoe1UpToSecondOrderO2) {
  for (const bool rigid : {false, true}) {
    const AcousticScene scene(rooms::shoe1(rigid ? 0.0 : 0.2, 0), early_config(2));
    const auto arrivals = arrivals_in(scene, rooms::shoe1_source(), rooms::shoe1_listener());
    // Direct, 6 walls, 12 pairs of different axes and the 6 of one axis (z0+z1 twice, and so on): 25 images of order <= 2.
    ASSERT_EQ(arrivals.size(), 25u);
    std::vector<bool> used(arrivals.size(), false);
    for (const Shoe1Row& row : kShoe1) {
      const glm::vec3 direction(rooms::point(row.direction.x, row.direction.y, row.direction.z));
      bool found = false;
      for (std::size_t i = 0; i < arrivals.size() && !found; ++i) {
        const Arrival& a = arrivals[i];
        if (used[i] || a.order != row.order || std::abs(a.distance_m - row.distance_m) > 1e-6 * row.distance_m ||
            glm::length(a.direction - direction) > 2e-6f) {
          continue;  // 1e-6: float coordinates of the corners; directions of the sheet have six decimals
        }
        const double amplitude = rigid ? row.rigid_amplitude : row.amplitude;
        EXPECT_NEAR(a.amplitude[0], amplitude, 1e-6 * amplitude);
        used[i] = found = true;
      }
      EXPECT_TRUE(found) << row.distance_m;
    }
    for (std::size_t i = 1; i < arrivals.size(); ++i) EXPECT_LE(arrivals[i - 1].distance_m, arrivals[i].distance_m);
    // #5 and #6 come at the same time from opposite sides (H-74): both are there.
    EXPECT_EQ(arrivals[5].distance_m, arrivals[6].distance_m);
    EXPECT_LT(arrivals[5].direction.x * arrivals[6].direction.x, 0.f);
  }
}

TEST(ImagePaths, Shoe2PerWallAndBandO3) {
  const double absorption[6][6] = {{.02, .02, .03, .04, .05, .07}, {.35, .25, .18, .12, .07, .04}, {.29, .10, .05, .04, .07, .09},
                                   {.29, .10, .05, .04, .07, .09}, {.08, .24, .57, .69, .71, .73}, {.50, .70, .60, .70, .70, .50}};
  // One band of the configuration at a time, so that band means do not blur the values of the sheet.
  for (int band = 0; band < 6; ++band) {
    std::array<Material, 6> walls;
    for (int w = 0; w < 6; ++w) walls[w] = Material::uniform("wall", static_cast<float>(absorption[w][band]), 0.f);
    const AcousticScene scene(rooms::box(8, 6, 3.5, walls), early_config(3));
    const auto arrivals = arrivals_in(scene, rooms::point(2.0, 1.7, 1.5), rooms::point(5.6, 4.1, 1.2));
    ASSERT_GE(arrivals.size(), 20u);
    std::vector<bool> used(arrivals.size(), false);
    for (const Shoe2Row& row : kShoe2) {
      bool found = false;
      for (std::size_t i = 0; i < arrivals.size() && !found; ++i) {
        found = !used[i] && arrivals[i].order == row.order && std::abs(arrivals[i].distance_m - row.distance_m) < 1e-6 * row.distance_m &&
                std::abs(arrivals[i].amplitude[0] - row.amplitude[band]) < 2e-6 * row.amplitude[band];
        if (found) used[i] = true;
      }
      EXPECT_TRUE(found) << "r " << row.distance_m << " order " << row.order << " band " << band;
    }
    // Nothing may come between.  (The 20th has a twin at the same distance, x0+y1, as the 17th is the twin of the 16th.)
    int earlier = 0;
    for (const Arrival& a : arrivals) earlier += a.distance_m < kShoe2[19].distance_m - 1e-4 ? 1 : 0;
    EXPECT_EQ(earlier, 19);
  }
}

TEST(ImagePaths, ScatteredEnergyIsLeftToTheLateField) {
  const AcousticScene scene(rooms::shoe1(0.2, 0.3), early_config(1));
  const auto arrivals = arrivals_in(scene, rooms::shoe1_source(), rooms::shoe1_listener());
  ASSERT_EQ(arrivals.size(), 7u);
  const double expected = kShoe1[1].rigid_amplitude * std::sqrt(0.8 * 0.7);
  EXPECT_NEAR(arrivals[1].amplitude[0], expected, 1e-6 * expected);
  const AcousticScene diffuse(rooms::shoe1(0.2, 1), early_config(2));
  EXPECT_EQ(arrivals_in(diffuse, rooms::shoe1_source(), rooms::shoe1_listener()).size(), 1u);  // only the direct sound is left
}

TEST(ImagePaths, HalfSpaceO7) {
  struct Case {
    double source_height_m, listener_height_m, distance_m, absorption, r1, r2, a1, a2;
  };
  for (const Case& c :
       {Case{1.5, 1.5, 10, 0, 10, 10.44031, 0.00795775, 0.00762214}, Case{2.0, 1.2, 25, 0.3, 25.0128, 25.20397, 0.00318147, 0.00264162},
        Case{1.5, 1.5, 3, 0.05, 3, 4.242641, 0.0265258, 0.0182817}}) {
    const AcousticScene scene(rooms::half_space(c.absorption, 0), early_config(3));
    const auto arrivals = arrivals_in(scene, rooms::point(0, 0, c.source_height_m), rooms::point(c.distance_m, 0, c.listener_height_m));
    ASSERT_EQ(arrivals.size(), 2u);
    EXPECT_NEAR(arrivals[0].distance_m, c.r1, 1e-5 * c.r1);
    EXPECT_NEAR(arrivals[1].distance_m, c.r2, 1e-5 * c.r2);
    EXPECT_NEAR(arrivals[0].amplitude[0], c.a1, 1e-5 * c.a1);
    EXPECT_NEAR(arrivals[1].amplitude[0], c.a2, 1e-5 * c.a2);
  }
}

TEST(ImagePaths, SwapGivesTheSameBitsO17) {
  const AcousticScene scene(rooms::shoe1(0.2, 0.1), early_config(3));
  for (const glm::vec3 listener : {rooms::shoe1_listener(), rooms::point(0.7, 3.1, 2.2), rooms::point(4.6, 0.4, 0.3)}) {
    const auto forward = arrivals_in(scene, rooms::shoe1_source(), listener);
    const auto back = arrivals_in(scene, listener, rooms::shoe1_source());
    ASSERT_EQ(forward.size(), back.size());
    for (std::size_t i = 0; i < forward.size(); ++i) {
      EXPECT_EQ(forward[i].distance_m, back[i].distance_m);
      EXPECT_EQ(forward[i].amplitude[0], back[i].amplitude[0]);
      EXPECT_EQ(forward[i].order, back[i].order);
    }
  }
}

TEST(ImagePaths, PathThroughAnEdgeCountsOnce) {
  // Source and listener in a symmetric plane of two walls at right angles: the second-order path goes through the edge, and both
  // sequences find it.
  const AcousticScene scene(rooms::box(4, 4, 3, rooms::uniform_walls(0.2, 0)), early_config(2));
  const auto arrivals = arrivals_in(scene, rooms::point(1, 1, 1.5), rooms::point(2, 2, 1.5));
  int through_edge = 0;
  for (const Arrival& a : arrivals) through_edge += a.order == 2 && std::abs(a.distance_m - 3 * std::sqrt(2.0)) < 1e-5 ? 1 : 0;
  EXPECT_EQ(through_edge, 1);
}

TEST(ImagePaths, TiledWallsGiveTheSameListAsWholeOnes) {
  // The floor cut into 64 pieces is one mirror: no image appears twice, none is lost at a seam.
  TriangleMesh mesh;
  for (int i = 0; i < 8; ++i)
    for (int j = 0; j < 8; ++j) {
      const auto at = [&](int di, int dj) { return rooms::point(-10 + 2.5 * (i + di), -10 + 2.5 * (j + dj), 0); };
      rooms::append_quad(mesh, {at(0, 0), at(1, 0), at(1, 1), at(0, 1)}, 0);
    }
  const AcousticScene scene(rooms::scene_of(mesh, {Material::uniform("m", 0.f, 0.f)}), early_config(2));
  EXPECT_EQ(scene.planes().size(), 1u);
  for (int step = 0; step < 20; ++step) {
    const auto arrivals = arrivals_in(scene, rooms::point(-3.1, 0.2, 1), rooms::point(-2.5 + 0.25 * step, 0.2, 1));
    ASSERT_EQ(arrivals.size(), 2u) << step;
    EXPECT_EQ(arrivals[1].order, 1);
  }
}

TEST(ImagePaths, FinitePanelEndsItsReflection) {
  TriangleMesh mesh;
  rooms::append_quad(mesh, {glm::vec3(-1, 0, -1), {1, 0, -1}, {1, 0, 1}, {-1, 0, 1}}, 0);
  const AcousticScene scene(rooms::scene_of(mesh, {Material::uniform("panel", 0.f, 0.f)}), early_config(2));
  EXPECT_EQ(arrivals_in(scene, {-0.5f, 1, 0}, {0.5f, 1, 0}).size(), 2u);
  const auto past = arrivals_in(scene, {-0.5f, 1, 0}, {4.f, 1, 0});  // mirror point at x = 1.75, past the panel
  EXPECT_EQ(std::ranges::count(past, ArrivalKind::direct, &Arrival::kind), 1);
  EXPECT_EQ(std::ranges::count(past, ArrivalKind::reflection, &Arrival::kind), 0);
  EXPECT_EQ(arrivals_in(scene, {-0.5f, 1, 0}, {0.5f, -1, 0}).size(), 0u);   // behind the panel: hidden, and no mirror either
  EXPECT_EQ(arrivals_in(scene, {-0.5f, -1, 0}, {0.5f, -1, 0}).size(), 2u);  // the back side mirrors too
}

TEST(ImagePaths, FurnishedRoomsNeedNoExhaustiveSearch) {
  // 60 boxes in a room: too many planes for all pairs, but the walls' pairs are found by rays.
  TriangleMesh mesh;
  append_box(mesh, {0, 0, 0}, {12, 3, 12}, 0, 0);
  for (int i = 0; i < 60; ++i) {
    const glm::vec3 low(0.7f + 1.1f * static_cast<float>(i % 10), 0.1f, 0.7f + 1.1f * static_cast<float>(i / 10));
    append_box(mesh, low, low + glm::vec3(0.31f, 0.4f + 0.003f * static_cast<float>(i), 0.29f), 0, 0);
  }
  const AcousticScene scene(rooms::scene_of(mesh, {Material::uniform("m", 0.1f, 0.1f)}), early_config(2));
  ASSERT_GT(scene.planes().size(), 64u);  // 64^2 pairs are more than the exhaustive search takes
  const auto arrivals = arrivals_in(scene, {2, 1.6f, 3}, {9, 1.5f, 8});
  int first_order = 0;
  for (const Arrival& a : arrivals) first_order += a.order == 1 ? 1 : 0;
  EXPECT_GE(first_order, 5);  // four walls and the ceiling see both; the floor is partly hidden
}

TEST(ImagePaths, SameQuerySameBitsH51) {
  const AcousticScene scene(rooms::shoe1(0.2, 0.1), early_config(2));
  const EarlyCandidates candidates(scene, rooms::shoe1_source());
  std::vector<Arrival> first, again;
  candidates.find_arrivals(scene, rooms::shoe1_listener(), first);
  for (int i = 0; i < 100; ++i) {
    again.clear();
    candidates.find_arrivals(scene, rooms::shoe1_listener(), again);
    ASSERT_EQ(again.size(), first.size());
    for (std::size_t k = 0; k < first.size(); ++k) {
      EXPECT_EQ(again[k].distance_m, first[k].distance_m);
      EXPECT_EQ(again[k].direction, first[k].direction);
      EXPECT_EQ(again[k].amplitude, first[k].amplitude);
    }
  }
}

}  // namespace
}  // namespace earshot
