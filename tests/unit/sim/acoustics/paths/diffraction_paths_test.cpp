// SPDX-License-Identifier: Apache-2.0
#include "sim/acoustics/paths/diffraction_paths.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <chrono>
#include <cmath>
#include <complex>
#include <cstdlib>
#include <filesystem>
#include <numbers>

#include "sim/acoustics/metrics/room_metrics.h"
#include "sim/acoustics/response/energy_response.h"
#include "sim/base/random.h"
#include "sim/scene/scene.h"
#include "tests/support/acoustics/coherent_field.h"
#include "tests/support/acoustics/rigid_plate.h"
#include "tests/support/acoustics/rooms.h"
#include "tests/support/acoustics/wedge_cases.h"
#include "tests/support/files/test_data.h"

namespace earshot {
namespace {

using namespace coherent_field;
using Complex = std::complex<double>;

std::shared_ptr<const Scene> hard(TriangleMesh mesh) { return rooms::scene_of(std::move(mesh), {Material::uniform("hard", 0.f, 0.f)}); }

/// The wedge of a case, long and wide, edge on the y axis (theirs: z), first face along +x.
TriangleMesh wedge_mesh(double exterior_rad) {
  const float reach = 200;
  TriangleMesh mesh;
  rooms::append_quad(mesh, {glm::vec3(0, -reach, 0), glm::vec3(reach, -reach, 0), glm::vec3(reach, reach, 0), glm::vec3(0, reach, 0)}, 0);
  if (exterior_rad > 1.9 * std::numbers::pi) return mesh;
  const glm::vec3 tip(reach * std::cos(exterior_rad), 0, -reach * std::sin(exterior_rad));
  rooms::append_quad(mesh, {glm::vec3(0, -reach, 0), tip - glm::vec3(0, reach, 0), tip + glm::vec3(0, reach, 0), glm::vec3(0, reach, 0)},
                     0);
  return mesh;
}

glm::vec3 cylindrical(const std::array<double, 3>& at) {
  return {static_cast<float>(at[0] * std::cos(at[1])), static_cast<float>(at[2]), static_cast<float>(-at[0] * std::sin(at[1]))};
}

TEST(O24Diffraction, PathsOverWedgesHaveTheTabulatedLoss) {
  for (const wedges::WedgeCase& wedge : wedges::kCases) {
    const auto scene_geometry = hard(wedge_mesh(wedge.exterior_rad));
    const AcousticScene scene(scene_geometry, config_with(Switch::on));
    const glm::vec3 source = cylindrical(wedge.source), listener = cylindrical(wedge.listener);
    const auto arrivals = arrivals_of(scene, source, listener);
    ASSERT_EQ(arrivals.size(), 1u) << wedge.name;
    EXPECT_EQ(arrivals[0].kind, ArrivalKind::diffraction);
    EXPECT_EQ(arrivals[0].order, 1);
    const double path_m = std::hypot(wedge.source[0] + wedge.listener[0], wedge.source[2] - wedge.listener[2]);
    EXPECT_NEAR(arrivals[0].distance_m, path_m, 1e-5 * path_m);
    const double direct_m = glm::length(source - listener);
    for (int band = 0; band < scene.num_bands(); ++band) {
      // The table has nominal frequencies, bands have exact midbands (1.2 % apart at most): 0.04 dB.  The highest band is cut at 8 kHz.
      for (std::size_t i = 0; i < wedges::kFrequencyHz.size(); ++i) {
        if (std::abs(scene.bands().centre_hz[band] / wedges::kFrequencyHz[i] - 1) > 0.02) continue;
        const double loss = -rooms::amplitude_db(4 * std::numbers::pi * direct_m * arrivals[0].amplitude[band]);
        EXPECT_NEAR(loss, wedge.utd_db[i], 0.06) << wedge.name << " " << wedges::kFrequencyHz[i];
      }
    }
    // Sound leaves toward the edge and comes from it; equal angles with the edge.
    EXPECT_NEAR(arrivals[0].departure.y, -arrivals[0].direction.y, 1e-5);
  }
}

TEST(Diffraction, ConvexRoomGivesTheBitsOfOff) {
  for (const Switch choice : {Switch::automatic, Switch::on}) {
    EnergyResponse with, without;
    for (const bool off : {false, true}) {
      AcousticConfig config;
      config.diffraction = off ? Switch::off : choice;
      const AcousticScene scene(rooms::shoe1(0.2, 0.3), config);
      compute_energy_response(scene, EarlyCandidates(scene, rooms::shoe1_source()), rooms::shoe1_listener(), off ? without : with);
    }
    ASSERT_EQ(with.arrivals.size(), without.arrivals.size());
    for (std::size_t i = 0; i < with.arrivals.size(); ++i) {
      EXPECT_EQ(with.arrivals[i].amplitude, without.arrivals[i].amplitude);
      EXPECT_EQ(with.arrivals[i].distance_m, without.arrivals[i].distance_m);
    }
    for (int bin = 0; bin < with.late.num_bins(); ++bin)
      for (int band = 0; band < with.late.num_bands(); ++band) ASSERT_EQ(with.late.energy(bin, band), without.late.energy(bin, band));
  }
}

TEST(Diffraction, LevelFollowsAListenerPastACorner) {
  // Corner of 270 degrees; the source lies near one face, the listener walks out of the shadow and past the reflection boundary.
  const AcousticScene scene(hard(wedge_mesh(1.5 * std::numbers::pi)), config_with(Switch::on));
  const glm::vec3 source = cylindrical({3, 0.7, 0});
  const EarlyCandidates candidates(scene, source);
  EnergyResponse response;
  const std::size_t band = 3;  // 1 kHz
  double last_db = 0, largest_db = 0;
  int without_sight = 0;
  for (int step = 0; step < 300; ++step) {
    const glm::vec3 listener(-1.2f, 0.3f, 2.5033f - 0.01f * static_cast<float>(step));
    compute_energy_response(scene, candidates, listener, response);
    const double level = rooms::amplitude_db(std::abs(pressure(scene, response.arrivals, band)));
    if (step > 0) largest_db = std::max(largest_db, std::abs(level - last_db));
    last_db = level;
    if (response.arrivals[0].kind != ArrivalKind::direct) ++without_sight;
  }
  EXPECT_GT(without_sight, 50);
  EXPECT_LT(without_sight, 250);
  EXPECT_LT(largest_db, 0.5);  // 6 dB at the shadow boundary without the lit side's fraction, endless without any
}

TEST(Diffraction, MetricsAreContinuousThroughTheShadowBoundary) {
  AcousticConfig config = config_with(Switch::on);
  config.early = Switch::off;  // its reflections are not part of this; nor is the reflection boundary, which is never reached
  const AcousticScene scene(hard(wedge_mesh(1.5 * std::numbers::pi)), config);
  const EarlyCandidates candidates(scene, cylindrical({3, 1.5, 0}));
  EnergyResponse response;
  std::vector<double> last;
  int in_sight = 0;
  for (int step = 0; step < 150; ++step) {
    const double angle = 4.69 - 0.005 * step;  // from behind the corner past the boundary at 1.5 + pi = 4.64
    compute_energy_response(scene, candidates, cylindrical({2, angle, 0}), response);
    const RoomMetrics metrics = measure(scene, response);
    EXPECT_EQ(metrics.direct_delay_s.has_value(), response.arrivals[0].kind == ArrivalKind::direct);
    in_sight += metrics.direct_delay_s.has_value() ? 1 : 0;
    std::vector<double> level;
    for (const BandMetrics& band : metrics.bands) level.push_back(band.g_db.value());
    for (std::size_t b = 0; b < last.size(); ++b) EXPECT_LT(std::abs(level[b] - last[b]), b < 5 ? 0.35 : 0.6) << b << " " << step;
    last = level;
  }
  EXPECT_GT(in_sight, 100);
  EXPECT_LT(in_sight, 145);
  // Far in the light the diffracted sound changes an octave by little: the free field at 4.5 m or so, re 10 m.
  const double free_db = 20 * std::log10(10 / glm::length(cylindrical({3, 1.5, 0}) - cylindrical({2, 4.69 - 0.745, 0})));
  for (const double level : last) EXPECT_NEAR(level, free_db, 1.4);
}

TEST(Diffraction, SwappedEndsGiveTheSameBits) {
  TriangleMesh mesh;
  append_box(mesh, {-1, 0, -0.5f}, {1, 2, 0.5f}, 0, 0);
  append_box(mesh, {2, 0, -1}, {3, 2.5f, 1}, 0, 0);
  // Single edges, so that both ends find the same paths: the bound on the energy of all of them is one of the set.
  AcousticConfig config = config_with(Switch::on);
  config.diffraction_order = 1;
  const AcousticScene scene(hard(mesh), config);
  int found = 0;
  for (std::uint32_t i = 0; i < 20; ++i) {
    const RandomStream random(7, Purpose::test, i);
    const auto point = [&](std::uint32_t draw, float z) {
      return glm::vec3(-3.f + 7.f * random.uniform(draw), 0.1f + 2.f * random.uniform(draw + 1), z);
    };
    const glm::vec3 a = point(0, 2.f), b = point(2, -2.f);
    auto forth = arrivals_of(scene, a, b), back = arrivals_of(scene, b, a);
    ASSERT_EQ(forth.size(), back.size());
    for (const Arrival& arrival : forth) {
      if (arrival.kind != ArrivalKind::diffraction) continue;
      const auto same = std::find_if(back.begin(), back.end(), [&](const Arrival& other) {
        return other.amplitude == arrival.amplitude && other.phase_rad == arrival.phase_rad && other.distance_m == arrival.distance_m &&
               other.direction == arrival.departure && other.departure == arrival.direction;
      });
      EXPECT_NE(same, back.end());
      ++found;
    }
  }
  EXPECT_GT(found, 40);
}

TEST(Diffraction, BendsOverTwoEdgesOfAThickWall) {
  // A wall 10 m thick: the way leads over both top edges, and is longer than the straight one by what a string would need.
  TriangleMesh mesh;
  append_box(mesh, {-1000, -500, -5}, {1000, 20, 5}, 0, 0);
  const AcousticScene scene(hard(mesh), config_with(Switch::on));
  const auto arrivals = arrivals_of(scene, {0, 10, 35}, {0, 10, -35});
  ASSERT_FALSE(arrivals.empty());
  EXPECT_EQ(arrivals[0].order, 2);
  const double segment_m = std::hypot(30.0, 10.0), path_m = 2 * segment_m + 10;
  EXPECT_NEAR(arrivals[0].distance_m, path_m, 1e-4);
  // Keller's product far from all boundaries, 4 kHz: D = exp(-j pi/4) / (n sqrt(2 pi k)) sin(pi/n) [1 / (cos(pi/n) - cos((a - b)/n)) +
  // 1 / (cos(pi/n) - cos((a + b)/n))] at each edge, half of one for the segment along the top, over sqrt(s0 s1 s2 (s0 + s1 + s2)).
  const std::size_t band = 5;
  const double k = 2 * std::numbers::pi * scene.bands().centre_hz[band] / 343, n = 1.5, slope = std::atan2(10.0, 30.0);
  const auto keller = [&](double a, double b) {
    const auto term = [&](double angle) { return 1 / (std::cos(std::numbers::pi / n) - std::cos(angle / n)); };
    return std::sin(std::numbers::pi / n) / (n * std::sqrt(2 * std::numbers::pi * k)) * (term(a - b) + term(a + b));
  };
  const double in = std::numbers::pi / 2 - slope;  // from the front face
  const double expected = std::abs(keller(in, 1.5 * std::numbers::pi) * keller(0, 1.5 * std::numbers::pi - in)) / 2 /
                          std::sqrt(segment_m * 10 * segment_m * path_m) / (4 * std::numbers::pi);
  EXPECT_NEAR(rooms::amplitude_db(arrivals[0].amplitude[band] / expected), 0, 0.06);  // the rest of the transition functions, 1 / (2 k L)
}

TEST(Diffraction, ThickWallsAgainstBiotTolstoyMedwin) {
  // Insertion loss of the way over both edges of an endless rigid wall: double line integral of Svensson, Fred and Vanderkooy 1999 (second
  // order, factor 1/2 for the common face), by brute force in a program of its own that meets D4 of O-24 to 1e-3 dB in first order.
  // In front and behind: distance from the wall and depth below its top; width.  125, 500, 2000 Hz.
  struct Wall {
    double front_m, below_source_m, thick_m, behind_m, below_listener_m;
    std::array<double, 3> loss_db;
  };
  const std::array<Wall, 5> walls = {{{3, 1, 3, 3, 1, {11.148, 17.342, 26.452}},
                                      {3, 1, 1, 3, 1, {10.473, 16.034, 23.961}},
                                      {3, 1, 0.2, 3, 1, {9.875, 14.901, 21.450}},
                                      {2, 0.3, 0.2, 3, 1.5, {9.020, 13.686, 19.855}},
                                      {3, 1, 0.1, 2, 0.5, {8.585, 12.951, 18.805}}}};
  for (const Wall& wall : walls) {
    TriangleMesh mesh;
    const auto half = static_cast<float>(wall.thick_m / 2);
    append_box(mesh, {-300, -300, -half}, {300, 0, half}, 0, 0);
    const auto scene = hard(mesh);
    const DiffractionEdges edges(*scene, 0.05f);
    EdgeSequence sequence{.edge = {}, .order = 2};
    for (std::uint32_t e = 0; e < edges.size(); ++e) {
      const glm::dvec3 middle = edges[e].at(0.5 * edges[e].length_m);
      if (std::abs(middle.x) < 1 && std::abs(middle.y) < 1) sequence.edge[middle.z > 0 ? 0 : 1] = e;
    }
    const glm::dvec3 source(0, -wall.below_source_m, half + wall.front_m), listener(0, -wall.below_listener_m, -half - wall.behind_m);
    EdgePath path;
    ASSERT_TRUE(shortest_path(edges, sequence, source, listener, path));
    const EdgePathField field(edges, path);
    ASSERT_TRUE(field.valid());
    std::array<double, kLanes> wavenumbers;
    wavenumbers.fill(2 * std::numbers::pi * 2000 / 343);
    for (std::size_t i = 0; i < 2; ++i) wavenumbers[i] = 2 * std::numbers::pi * std::array<double, 2>{125, 500}[i] / 343;
    const FaceLanes rigid{.reflected = all_lanes(1), .transmitted = {}};
    const ComplexLanes ratio =
        field.ratio(EdgeBands{.first = 0, .count = 3, .wave = WaveLanes(wavenumbers), .air_per_m = {}, .face = {rigid}});
    for (std::size_t i = 0; i < 3; ++i) {
      const double k = wavenumbers[i];
      const double loss = -rooms::amplitude_db(std::sqrt(norm(ratio)[i]) * glm::length(source - listener) / path.length_m);
      // Second order alone misses what goes back and forth on top, the more the thinner the wall: compare where k w > 3.
      EXPECT_NEAR(loss, wall.loss_db[i], k * wall.thick_m > 3 ? 0.65 : 2.0) << wall.thick_m << " m, k " << k;
    }
  }
}

TEST(Diffraction, EdgesOnTheSameLineOfAThinWallJoinTheSingleEdge) {
  // Listener rises behind a wall 0.2 m thick out of the shadow of its second edge: two edges, then one; no step.
  TriangleMesh mesh;
  append_box(mesh, {-100, -50, -0.1f}, {100, 2, 0.1f}, 0, 0);
  AcousticConfig config = config_with(Switch::on);
  config.early = Switch::off;
  const AcousticScene scene(hard(mesh), config);
  const EarlyCandidates candidates(scene, glm::vec3(0, 0.5f, 3));
  EnergyResponse response;
  double last_db = 0, largest_db = 0;
  int orders = 0;
  for (int step = 0; step < 400; ++step) {
    compute_energy_response(scene, candidates, {0.2f, 0.5033f + 0.01f * static_cast<float>(step), -2}, response);
    ASSERT_FALSE(response.arrivals.empty());
    orders |= 1 << response.arrivals[0].order;
    const double level = rooms::amplitude_db(std::abs(pressure(scene, response.arrivals, 3)));
    if (step > 0) largest_db = std::max(largest_db, std::abs(level - last_db));
    last_db = level;
  }
  EXPECT_EQ(orders, 7);  // two edges, one edge, in sight
  EXPECT_LT(largest_db, 1.0);
}

TEST(Diffraction, FadesWhereTheEdgeEnds) {
  // The corner of a screen; source and listener walk past its side, below its top: the top's end, then sight.  (Further in, the sound of
  // both edges cancels at places: steep, but no jump.)
  TriangleMesh mesh;
  rooms::append_quad(mesh, {glm::vec3(-40, -40, 0), glm::vec3(1, -40, 0), glm::vec3(1, 1, 0), glm::vec3(-40, 1, 0)}, 0);
  const AcousticScene scene(hard(mesh), config_with(Switch::on));
  double last_db = 0, largest_db = 0;
  for (int step = 0; step < 140; ++step) {
    const float x = 0.6033f + 0.01f * static_cast<float>(step);
    const double level = rooms::amplitude_db(std::abs(pressure(scene, arrivals_of(scene, {x, 0.2f, 2}, {x, 0.2f, -2}), 3)));
    if (step > 0) largest_db = std::max(largest_db, std::abs(level - last_db));
    last_db = level;
  }
  EXPECT_LT(largest_db, 1.0);
}

TEST(Diffraction, NoEdgeWaveWhereAnImageIsLitButNoCandidate) {
  // Without image paths, mirrors are the tracers': an image that is lit needs no edge to make up for it.  A corner of 270 degrees, source
  // at 1.2 rad from one face: its image there ends at pi - 1.2.
  AcousticConfig config = config_with(Switch::on);
  config.early = Switch::off;
  const AcousticScene scene(hard(wedge_mesh(1.5 * std::numbers::pi)), config);
  for (const double angle : {1.0, 1.5, 1.9}) {
    const auto lit = arrivals_of(scene, cylindrical({3, 1.2, 0}), cylindrical({2, angle, 0}));
    ASSERT_EQ(lit.size(), 1u) << angle;
    EXPECT_EQ(lit[0].kind, ArrivalKind::direct);
  }
  // On the other side the tracers have nothing: half the image's pressure at its end, the edge's.
  const auto ended = arrivals_of(scene, cylindrical({3, 1.2, 0}), cylindrical({2, 1.95, 0}));
  ASSERT_EQ(ended.size(), 2u);
  EXPECT_NEAR(4 * std::numbers::pi * ended[1].distance_m * ended[1].amplitude[0], 0.5, 0.05);
}

TEST(Diffraction, NarrowFacesReflectByTheirWidth) {
  // A strip in the air, the point of reflection past one of its long edges: against the Kirchhoff sum over its face.  Its two edges cancel
  // but for its width; either alone is half an image.
  const double depth_m = 8;
  int close = 0;
  for (const double width_m : {0.03, 0.1, 0.3}) {
    TriangleMesh mesh;
    const auto half = static_cast<float>(width_m / 2), end = static_cast<float>(depth_m / 2);
    rooms::append_quad(mesh, {glm::vec3(-half, 0, -end), glm::vec3(half, 0, -end), glm::vec3(half, 0, end), glm::vec3(-half, 0, end)}, 0);
    const AcousticScene scene(hard(mesh), config_with(Switch::on));
    const glm::vec3 source(-4, 1.5f, 0.3f);
    const EarlyCandidates candidates(scene, source);
    for (const float x : {1.f, 2.5f, 6.5f, 8.5f}) {
      const glm::vec3 listener(x, 1.9f, -0.2f);
      const double reflected_at_m = (1.9 * -4 + 1.5 * x) / 3.4;
      ASSERT_GT(std::abs(reflected_at_m), width_m / 2);
      std::vector<Arrival> arrivals = arrivals_of(scene, candidates, listener);
      std::erase_if(arrivals, [](const Arrival& arrival) { return arrival.kind != ArrivalKind::diffraction; });
      const double image_m = glm::length(glm::dvec3(source.x, -source.y, source.z) - glm::dvec3(listener));
      for (int band = 0; band < scene.num_bands(); ++band) {
        const double k = 2 * std::numbers::pi * scene.bands().centre_hz[band] / scene.speed_of_sound_m_per_s();
        const Complex truth = rigid_plate::reflected(width_m, depth_m, glm::dvec3(source), glm::dvec3(listener), k);
        const double error = 4 * std::numbers::pi * image_m * std::abs(pressure(scene, arrivals, static_cast<std::size_t>(band)) - truth);
        // Of a free path as long as the image's; each edge is within 1.5 % of it, or 1 dB (finite_edge.h).  Ways over the edges that
        // are longer than the image's by half a wave count no more.
        double least_waves = 1e9, most_waves = 0;
        for (const double side_m : {-width_m / 2, width_m / 2}) {
          const double way_m = std::hypot(std::hypot(-4 - side_m, 1.5) + std::hypot(x - side_m, 1.9), 0.5);
          least_waves = std::min(least_waves, (way_m - image_m) * k / (2 * std::numbers::pi));
          most_waves = std::max(most_waves, (way_m - image_m) * k / (2 * std::numbers::pi));
        }
        if (most_waves < 0.25) {
          ++close;
          EXPECT_LT(error, 0.03 + 0.12 * 4 * std::numbers::pi * image_m * std::abs(truth))
              << width_m << " m, listener at " << x << ", " << scene.bands().centre_hz[band] << " Hz";
        } else if (least_waves > 0.5) {
          EXPECT_LE(error, 4 * std::numbers::pi * image_m * std::abs(truth) * (1 + 1e-6));
        }
      }
    }
  }
  EXPECT_GT(close, 40);
}

TEST(Diffraction, ReflectionsThatEndWithoutTheirEdgesChangeAnOctaveByWhatThePlanStates) {
  // A large sheet, listeners about where the image in it ends, in sight: all edges against those near their shadow boundary.  Octaves are
  // sums over narrow bands.
  const auto geometry = hard(wedge_mesh(2 * std::numbers::pi));
  AcousticConfig config = config_with(Switch::on);
  config.bands = kMaxBands;
  const AcousticScene all(geometry, config);
  config.diffraction = Switch::automatic;
  config.rays = 64;
  const AcousticScene few(geometry, config);
  const auto decided = std::ranges::find(few.plan().decisions, "diffraction", &EffectDecision::effect);
  ASSERT_NE(decided, few.plan().decisions.end());
  ASSERT_EQ(decided->kind, BoundKind::approximated);
  const auto bands = static_cast<std::size_t>(all.num_bands());
  const double octaves = std::log2(all.bands().edge_hz.back() / all.bands().edge_hz.front());
  const auto per_octave = static_cast<std::size_t>(std::lround(static_cast<double>(bands) / octaves));
  double more_db = 0, less_db = 0;
  for (const double source_rad : {0.1, 0.2, 0.4, 0.8})
    for (const double source_m : {1.0, 3.0})
      for (const double listener_m : {1.0, 4.0}) {
        const glm::vec3 source = cylindrical({source_m, source_rad, 0});
        const EarlyCandidates by_all(all, source), by_few(few, source);
        EnergyResponse a, b;
        for (double angle = std::numbers::pi - source_rad - 0.5; angle < std::numbers::pi + source_rad; angle += 0.02) {
          const glm::vec3 listener = cylindrical({listener_m, angle, 0});
          compute_energy_response(all, by_all, listener, a);
          compute_energy_response(few, by_few, listener, b);
          for (std::size_t first = 0; first + per_octave <= bands; ++first) {
            double with = 0, without = 0;
            for (std::size_t i = first; i < first + per_octave; ++i) {
              with += std::norm(pressure(all, a.arrivals, i));
              without += std::norm(pressure(few, b.arrivals, i));
            }
            more_db = std::max(more_db, 10 * std::log10(with / without));
            less_db = std::max(less_db, 10 * std::log10(without / with));
          }
        }
      }
  // Seen: 2.7 dB more, 3.65 dB less.
  EXPECT_LT(std::max(more_db, less_db), decided->change);
  EXPECT_GT(std::max(more_db, less_db), decided->change - 0.5) << "the bound is not tight";
}

TEST(Diffraction, BoundedAtTheEdgeItself) {  // docs/evidence/stability.md, H-66, H-67
  const AcousticScene scene(hard(wedge_mesh(1.5 * std::numbers::pi)), config_with(Switch::on));
  for (const glm::vec3 listener :
       {glm::vec3(-0.001f, 0, 0.001f), glm::vec3(-1e-5f, 0, 1e-5f), glm::vec3(0, 0.5f, 0), glm::vec3(0, 250, 0)}) {
    const auto arrivals = arrivals_of(scene, {2, 0.2f, -2}, listener);
    const double most = 2.0 / (4 * std::numbers::pi * glm::length(listener - glm::vec3(2, 0.2f, -2)));
    for (const Arrival& arrival : arrivals)
      for (int band = 0; band < scene.num_bands(); ++band) {
        EXPECT_TRUE(std::isfinite(arrival.amplitude[band]) && std::isfinite(arrival.phase_rad[band]));
        EXPECT_LE(arrival.amplitude[band], most * 1.0001);
      }
  }
}

TEST(Diffraction, CombOfAThousandEdges) {  // docs/evidence/stability.md, H-68
  TriangleMesh mesh;
  for (int tooth = 0; tooth < 1000; ++tooth) {
    const float x = 0.02f * static_cast<float>(tooth);
    rooms::append_quad(mesh, {glm::vec3(x, 0, -5), glm::vec3(x, 0, 5), glm::vec3(x, 2, 5), glm::vec3(x, 2, -5)}, 0);
  }
  AcousticConfig config = config_with(Switch::on);
  config.diffraction_order = 10;
  const AcousticScene scene(hard(mesh), config);
  const glm::vec3 source(-2, 1, 0), listener(22, 1, 0.3f);
  const auto start = std::chrono::steady_clock::now();
  const auto arrivals = arrivals_of(scene, source, listener);
  EXPECT_LT(std::chrono::duration<double>(std::chrono::steady_clock::now() - start).count(), 20.0);  // 1 s on an idle core
  const double direct = 1 / (4 * std::numbers::pi * glm::length(source - listener));
  for (int band = 0; band < scene.num_bands(); ++band) {
    double energy = 0;
    for (const Arrival& arrival : arrivals) energy += double{arrival.amplitude[band]} * arrival.amplitude[band];
    EXPECT_LE(energy, direct * direct);
  }
}

TEST(Diffraction, FurnishedHouse) {
  SKIP_WITHOUT_DATA("scenes/small_house.glb");
  const auto house = std::make_shared<const Scene>(load_scene((data_folder() / "scenes/small_house.glb").string()));
  AcousticConfig config;  // automatic, as in training
  config.late = Switch::off;
  const AcousticScene scene(house, config);
  const glm::vec3 middle = 0.5f * (house->bounds().lower + house->bounds().upper);
  const glm::vec3 source(middle.x, house->bounds().lower.y + 1.5f, middle.z);
  const EarlyCandidates candidates(scene, source);
  EnergyResponse response;
  int found = 0;
  for (std::uint32_t i = 0; i < 60; ++i) {
    const RandomStream random(11, Purpose::test, i);
    const glm::vec3 listener = source + glm::vec3(16.f * random.uniform(0) - 8.f, 0.f, 9.f * random.uniform(1) - 4.5f);
    response.arrivals.clear();
    candidates.diffraction().find_arrivals(scene, listener, response.arrivals);
    EXPECT_LE(response.arrivals.size(), 8u);
    found += response.arrivals.empty() ? 0 : 1;
    const double direct_m = glm::length(source - listener);
    for (const Arrival& arrival : response.arrivals) {
      EXPECT_GE(arrival.distance_m, 0.9999 * direct_m);
      EXPECT_NEAR(glm::length(arrival.direction), 1, 1e-5);
      EXPECT_NEAR(glm::length(arrival.departure), 1, 1e-5);
      for (int band = 0; band < scene.num_bands(); ++band) {
        EXPECT_TRUE(std::isfinite(arrival.phase_rad[band]));
        EXPECT_LE(arrival.amplitude[band], 2 / (4 * std::numbers::pi * direct_m));
      }
    }
  }
  EXPECT_GT(found, 2);  // of those without sight
}

TEST(Diffraction, AutomaticWithFewRaysKeepsToTheShadowAndItsBoundary) {
  AcousticConfig config = config_with(Switch::automatic);
  config.rays = 64;
  const AcousticScene scene(hard(wedge_mesh(1.5 * std::numbers::pi)), config);
  const glm::vec3 source = cylindrical({3, 0.7, 0});
  const auto lit = arrivals_of(scene, source, cylindrical({3, 2.0, 0}));  // a detour of 2.4 m
  EXPECT_TRUE(std::none_of(lit.begin(), lit.end(), [](const Arrival& a) { return a.kind == ArrivalKind::diffraction; }));
  const auto dark = arrivals_of(scene, source, cylindrical({3, 4.3, 0}));
  EXPECT_TRUE(std::any_of(dark.begin(), dark.end(), [](const Arrival& a) { return a.kind == ArrivalKind::diffraction; }));

  // Out of the shadow, whose boundary is at 0.7 + pi, 1.5 cm a step: without diffraction in sight the step there is 6 dB.
  EnergyResponse response;
  const EarlyCandidates candidates(scene, source);
  double last_db = 0, largest_db = 0;
  int in_sight = 0;
  for (int step = 0; step < 260; ++step) {
    compute_energy_response(scene, candidates, cylindrical({3, 4.3 - 0.005 * step, 0}), response);
    const double level = rooms::amplitude_db(std::abs(pressure(scene, response.arrivals, 3)));  // 1 kHz
    if (step > 0) largest_db = std::max(largest_db, std::abs(level - last_db));
    last_db = level;
    in_sight += response.arrivals.front().kind == ArrivalKind::direct ? 1 : 0;
  }
  EXPECT_GT(in_sight, 100);
  EXPECT_LT(largest_db, 0.5);
}

}  // namespace
}  // namespace earshot
