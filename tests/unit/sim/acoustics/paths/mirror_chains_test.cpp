// SPDX-License-Identifier: Apache-2.0
#include "sim/acoustics/paths/mirror_chains.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdio>
#include <set>
#include <vector>

#include "sim/acoustics/geometry/convex_polygon.h"
#include "sim/acoustics/paths/early_reflections.h"
#include "sim/acoustics/response/energy_response.h"
#include "sim/acoustics/source_field/source_field.h"
#include "sim/base/random.h"
#include "sim/scene/materials/wall_impedance.h"
#include "tests/support/acoustics/decay.h"
#include "tests/support/acoustics/late_field.h"
#include "tests/support/acoustics/rooms.h"
#include "tests/support/acoustics/tilted_mirrors.h"

namespace earshot {
namespace {

using tilted::Mirrors;
constexpr glm::dvec3 kSource{1.7, -0.6, -1.2}, kListener{4.1, 0.8, -1.5};

AcousticConfig mirror_config() {
  AcousticConfig config = rooms::plain_config();
  config.early = Switch::on;
  config.early_order = 3;
  config.rays = 512;  // fewer get fewer chains
  config.rir_length_s = 1.f;
  config.time_bin_s = 0.001f;
  return config;
}

glm::vec3 at(glm::dvec3 p) { return rooms::point(p.x, p.y, p.z); }

/// The energy that has come by any time, from the chains and from every image of more than three reflections.  Counts the paths.
void expect_images(const Mirrors& mirrors, int most, double until_s, int& count) {
  const AcousticScene scene(mirrors.scene(), mirror_config());
  const EarlyCandidates candidates(scene, at(kSource));
  ASSERT_NE(candidates.long_chains(), nullptr);
  EXPECT_TRUE(candidates.long_chains()->facing().empty());
  EnergyHistogram histogram = make_histogram(scene);
  candidates.long_chains()->add_late(scene, at(kListener), histogram);
  std::vector<std::array<double, 2>> paths;  // time, energy
  mirrors.for_each_path(kSource, kListener, 4, most, [&](double length_m, int order) {
    paths.push_back({length_m / rooms::kSpeedMPerS, std::pow(1 - mirrors.absorption, order) * decay::direct_energy(length_m)});
  });
  std::sort(paths.begin(), paths.end());
  const auto come_by = [&](double time_s) {
    double sum = 0;
    for (int bin = 0; bin < histogram.num_bins() && static_cast<float>(bin + 1) * histogram.bin_s() <= time_s; ++bin)
      sum += histogram.energy(bin, 0);
    return sum;
  };
  // A path is dealt to the two bins that are nearest to it.
  const double slack_s = 2.01 * histogram.bin_s(), all = come_by(until_s);
  double sum = 0;
  count = 0;
  for (const auto& [time_s, energy] : paths) {
    if (time_s > until_s - slack_s) break;
    EXPECT_LE(come_by(time_s - slack_s), sum + 1e-4 * all) << time_s;
    sum += energy;
    EXPECT_GE(come_by(time_s + slack_s), sum - 1e-4 * all) << time_s;
    ++count;
  }
  std::printf("%d paths, energy over that of all images %.6f\n", count, all / sum);
  EXPECT_GT(count, 3);
}

TEST(MirrorChains, BetweenTiltedMirrorsAreAllImages) {
  int count = 0;
  for (const double tilt_deg : {0.7, 1.0, 2.0, 5.0}) expect_images(Mirrors(tilt_deg), 80, 1.0, count);
}

TEST(MirrorChains, GoOverAThirdMirrorToo) {
  // Up to 50 m, in which there are at most nine reflections between the two and three of the floor.
  int count = 0;
  expect_images(Mirrors(4, 0.05, true), 12, 50 / rooms::kSpeedMPerS, count);
}

TEST(MirrorChains, EndAtWhatStandsInTheirWay) {
  Mirrors mirrors(1);
  int free = 0, obstructed = 0;
  expect_images(mirrors, 80, 1.0, free);
  mirrors.screen_m = -1.4;
  expect_images(mirrors, 80, 1.0, obstructed);
  EXPECT_LT(obstructed, free);
}

/// A closed room of two hard end walls, of which one leans, and black walls that scatter nothing beside them.
std::shared_ptr<const Scene> leaning_room(double hard, double soft, double scattering) {
  TriangleMesh mesh;
  const double lean = 0.15;
  const std::array<glm::vec3, 8> p = {rooms::point(0, 0, 0),        rooms::point(6, 0, 0), rooms::point(6, 5, 0),
                                      rooms::point(0, 5, 0),        rooms::point(0, 0, 3), rooms::point(6 + lean, 0, 3),
                                      rooms::point(6 + lean, 5, 3), rooms::point(0, 5, 3)};
  const auto quad = [&](std::size_t a, std::size_t b, std::size_t c, std::size_t d, std::uint32_t material) {
    rooms::append_quad(mesh, {p[a], p[b], p[c], p[d]}, material);
  };
  quad(0, 3, 7, 4, 0);
  quad(1, 5, 6, 2, 0);
  quad(0, 1, 2, 3, 1);
  quad(4, 7, 6, 5, 1);
  quad(0, 4, 5, 1, 1);
  quad(3, 2, 6, 7, 1);
  return rooms::scene_of(std::move(mesh), {Material::uniform("hard", static_cast<float>(hard), 0.f),
                                           Material::uniform("soft", static_cast<float>(soft), static_cast<float>(scattering))});
}

TEST(MirrorChains, EachEstimatorLeavesOutWhatTheyCarry) {
  // Without image paths all mirrors are the tracer's own: the energy between 40 and 100 ms is the same.  Standard errors by seeds.
  const auto geometry = leaning_room(0.05, 0.6, 0.4);
  const glm::vec3 source = rooms::point(1.7, 2.0, 1.4), listener = rooms::point(4.1, 2.9, 1.6);
  struct Mean {
    double mean = 0, error = 0;
  };
  enum class Estimator { rays, bidirectional, field };
  const auto energy_of = [&](bool images, Estimator estimator) {
    double sum = 0, squares = 0;
    constexpr int kSeeds = 12;
    for (int seed = 0; seed < kSeeds; ++seed) {
      AcousticConfig config = mirror_config();
      config.late = Switch::on;
      config.early = images ? Switch::on : Switch::off;
      config.source_rays = estimator == Estimator::bidirectional ? 512 : 0;
      config.field = estimator == Estimator::field ? Switch::on : Switch::off;
      config.rays = images ? 8192 : 32'768;
      config.rir_length_s = 0.15f;
      config.seed = static_cast<std::uint64_t>(seed);
      const AcousticScene scene(geometry, config);
      const EarlyCandidates candidates(scene, source);
      EXPECT_EQ(candidates.long_chains() != nullptr, images);
      EnergyResponse response;
      std::shared_ptr<const SourceField> field;
      if (estimator == Estimator::field) field = build_source_field(scene, candidates);
      compute_energy_response(scene, candidates, field.get(), listener, response);
      double energy = 0;
      for (const Arrival& arrival : response.arrivals)
        if (const double time_s = arrival.distance_m / rooms::kSpeedMPerS; time_s >= 0.04 && time_s < 0.1)
          energy += double{arrival.amplitude[0]} * arrival.amplitude[0];
      for (int bin = 40; bin < 100; ++bin) energy += response.late.energy(bin, 0);
      sum += energy, squares += energy * energy;
    }
    const double mean = sum / kSeeds;
    return Mean{mean, std::sqrt(std::max(squares / kSeeds - mean * mean, 0.0) / (kSeeds - 1))};
  };
  const Mean tracer = energy_of(false, Estimator::rays);
  for (const Estimator estimator : {Estimator::rays, Estimator::bidirectional, Estimator::field}) {
    const Mean with = energy_of(true, estimator);
    const double error = std::hypot(tracer.error, with.error);
    std::printf("with chains over without: %.4f +- %.4f\n", with.mean / tracer.mean, error / tracer.mean);
    EXPECT_LT(error, 0.03 * tracer.mean);
    // A field knows a cell of 1 m, not a place.
    EXPECT_NEAR(with.mean, tracer.mean, 3 * error + (estimator == Estimator::field ? 0.05 * tracer.mean : 0.0));
  }
}

TEST(MirrorChains, AreNoneInOrdinaryRooms) {
  for (const auto& [hard, soft, scattering] : {std::array{0.1, 0.1, 0.1}, {0.3, 0.3, 0.2}, {0.02, 0.02, 0.0}}) {
    const AcousticScene scene(leaning_room(hard, soft, scattering), mirror_config());
    EXPECT_EQ(EarlyCandidates(scene, rooms::point(1.7, 2, 1.4)).long_chains(), nullptr) << hard << " " << soft << " " << scattering;
  }
}

TEST(MirrorChains, FewRaysKeepTheStrongestOfThem) {
  AcousticConfig config = mirror_config();
  const auto geometry = leaning_room(0.05, 0.6, 0.0);
  const EarlyCandidates all(AcousticScene(geometry, config), rooms::point(1.7, 2, 1.4));
  config.rays = 64;
  const EarlyCandidates few(AcousticScene(geometry, config), rooms::point(1.7, 2, 1.4));
  ASSERT_NE(few.long_chains(), nullptr);
  EXPECT_EQ(few.long_chains()->mirrors().size(), MirrorChains::kFewChains);
  EXPECT_GT(all.long_chains()->mirrors().size(), MirrorChains::kFewChains);
  EXPECT_NE(few.long_chains()->rule(), all.long_chains()->rule());
}

TEST(MirrorChains, NumbersTellOrdersApartFromBothEnds) {
  std::set<std::uint64_t> numbers;
  int chains = 0;
  for (std::uint32_t a = 0; a < 6; ++a)
    for (std::uint32_t b = 0; b < 6; ++b)
      for (std::uint32_t c = 0; c < 6; ++c)
        for (int length = 1; length <= 3; ++length) {
          MirrorChains::Chain forth, back;
          const std::array<std::uint32_t, 3> planes = {a, b, c};
          for (int i = 0; i < length; ++i) MirrorChains::extend(forth, planes[static_cast<std::size_t>(i)]);
          for (int i = length - 1; i >= 0; --i) MirrorChains::extend(back, planes[static_cast<std::size_t>(i)]);
          EXPECT_EQ(forth.from_source, back.from_listener);
          if (length == 3) numbers.insert(forth.from_source), ++chains;
        }
  EXPECT_EQ(numbers.size(), static_cast<std::size_t>(chains));
}

TEST(ConvexPolygon, PartsOfASquare) {
  const ConvexPolygon square = {{-1, -1, 0}, {1, -1, 0}, {1, 1, 0}, {-1, 1, 0}};
  EXPECT_EQ(clipped(square, {1, 0, 0}, 2).size(), 0u);
  EXPECT_EQ(clipped(square, {1, 0, 0}, -2).size(), 4u);
  const ConvexPolygon half = clipped(square, {1, 0, 0}, 0.5);
  ASSERT_EQ(half.size(), 4u);
  for (const glm::dvec3 vertex : half) EXPECT_GE(vertex.x, 0.5 - 1e-12);
  // An aperture of half the size halfway lights all of it but no more; one beside it, a quarter.
  const ConvexPolygon aperture = {{-0.5, -0.5, 1}, {0.5, -0.5, 1}, {0.5, 0.5, 1}, {-0.5, 0.5, 1}};
  EXPECT_EQ(lit_part(square, {0, 0, 2}, aperture).size(), 4u);
  const ConvexPolygon quarter = lit_part(square, {0, 0, 2}, {{0, 0, 1}, {0.5, 0, 1}, {0.5, 0.5, 1}, {0, 0.5, 1}});
  ASSERT_EQ(quarter.size(), 4u);
  for (const glm::dvec3 vertex : quarter) EXPECT_TRUE(vertex.x >= -1e-12 && vertex.y >= -1e-12);
}

// Hard walls that react locally reflect more at right angles than at random incidence, where the mean of these would end the search.  Every
// reflection of every image at its angle, 1e-3: single precision over up to twenty of them, and what is left of longer chains.
TEST(MirrorChains, ReflectByTheAngle) {
  for (std::uint32_t number = 0; number < 12; ++number) {
    const RandomStream random(514, Purpose::test, number);
    const double impedance = 8.5 + 3.5 * double{random.uniform(0)}, tilt_deg = 1 + 3 * double{random.uniform(1)};
    const Mirrors mirrors(tilt_deg);
    Material wall = Material::uniform("wall", static_cast<float>(random_incidence_absorption(impedance)), 0.f);
    wall.locally_reacting = true;
    wall.impedance_real = CoefficientCurve::constant(static_cast<float>(impedance));
    wall.impedance_imaginary = CoefficientCurve::constant(0.f);
    TriangleMesh mesh = mirrors.scene()->mesh();
    mesh.material_names.clear();
    const AcousticScene scene(rooms::scene_of(std::move(mesh), {wall, wall}), mirror_config());
    const EarlyCandidates candidates(scene, at(kSource));
    ASSERT_NE(candidates.long_chains(), nullptr) << impedance;
    EnergyHistogram histogram = make_histogram(scene);
    candidates.long_chains()->add_late(scene, at(kListener), histogram);
    double expected = 0;
    for (int order = 4; order <= 40; ++order)
      for (const int first : {0, 1}) {
        std::vector<int> sequence;
        for (int i = 0; i < order; ++i) sequence.push_back((first + i) % 2);
        const double length_m = mirrors.path_m(kSource, kListener, sequence);
        if (!(length_m > 0) || length_m > rooms::kSpeedMPerS) continue;
        glm::dvec3 image = kSource;
        for (const int m : sequence) {
          const Mirrors::Plane& plane = mirrors.planes[static_cast<std::size_t>(m)];
          image -= 2 * glm::dot(image - plane.point, plane.normal) * plane.normal;
        }
        glm::dvec3 direction = glm::normalize(image - kListener);
        double energy = decay::direct_energy(length_m);
        for (std::size_t i = sequence.size(); i-- > 0;) {
          const glm::dvec3 normal = mirrors.planes[static_cast<std::size_t>(sequence[i])].normal;
          energy *= std::norm(wall_reflection(impedance, std::abs(glm::dot(direction, normal))));
          direction -= 2 * glm::dot(direction, normal) * normal;
        }
        expected += energy;
      }
    ASSERT_GT(expected, 0);
    EXPECT_NEAR(rooms::total_energy(histogram), expected, 1e-3 * expected) << impedance << " " << tilt_deg;
  }
}

}  // namespace
}  // namespace earshot
