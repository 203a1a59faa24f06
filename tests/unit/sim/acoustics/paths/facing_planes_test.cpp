// SPDX-License-Identifier: Apache-2.0
#include "sim/acoustics/paths/facing_planes.h"

#include <gtest/gtest.h>

#include <cmath>
#include <numbers>

#include "sim/acoustics/paths/early_reflections.h"
#include "sim/acoustics/tracers/bidirectional_tracer.h"
#include "sim/base/random.h"
#include "tests/support/acoustics/decay.h"
#include "tests/support/acoustics/late_field.h"
#include "tests/support/acoustics/rooms.h"

namespace earshot {
namespace {

AcousticConfig mirror_config(int order) {
  AcousticConfig config = rooms::plain_config();
  config.early = Switch::on;
  config.early_order = order;
  config.rays = 512;  // fewer get fewer side planes
  config.rir_length_s = 1.f;
  config.time_bin_s = 0.001f;
  return config;
}

/// Walls x0 and x1 absorb `hard`, the others `soft`.
std::shared_ptr<const Scene> flutter_room(double hard, double soft, double scattering = 0) {
  std::array<Material, 6> walls = rooms::uniform_walls(soft, scattering);
  for (std::size_t i = 0; i < 2; ++i) walls[i] = rooms::uniform_walls(hard, scattering)[0];
  return rooms::box(6, 5, 3, walls);
}
glm::vec3 source() { return rooms::point(1.7, 2.0, 1.4); }
glm::vec3 listener() { return rooms::point(4.1, 2.9, 1.6); }

/// Energy in [from, to) of the images of the box with at least `least` bounces on x0 and x1 and at most `most` on the other walls.
double images(double hard, double soft, int least, int most, double from_s, double to_s) {
  const double size[3] = {6, 5, 3}, s[3] = {1.7, 2.0, 1.4}, l[3] = {4.1, 2.9, 1.6};
  const auto offset = [&](int axis, int n) { return n * size[axis] + (n % 2 == 0 ? s[axis] : size[axis] - s[axis]) - l[axis]; };
  double sum = 0;
  for (int x = -100; x <= 100; ++x)
    for (int y = -most; y <= most; ++y)
      for (int z = -most; z <= most; ++z) {
        if (std::abs(x) < least || std::abs(y) + std::abs(z) > most) continue;
        const double r = std::hypot(offset(0, x), offset(1, y), offset(2, z)), t = r / rooms::kSpeedMPerS;
        if (t < from_s || t >= to_s) continue;
        sum += std::pow(1 - hard, std::abs(x)) * std::pow(1 - soft, std::abs(y) + std::abs(z)) * decay::direct_energy(r);
      }
  return sum;
}

EnergyHistogram flutter(const AcousticScene& scene, const SoundSource& from, glm::vec3 to) {
  EnergyHistogram histogram = make_histogram(scene);
  const EarlyCandidates candidates(scene, from);
  if (candidates.long_chains()) candidates.long_chains()->add_late(scene, to, histogram);
  return histogram;
}

TEST(FacingPlanes, AddsTheImagesOfARowBetweenSideWalls) {
  for (const int order : {2, 3}) {
    const AcousticScene scene(flutter_room(0.02, 0.9), mirror_config(order));
    const EnergyHistogram histogram = flutter(scene, source(), listener());
    EXPECT_NEAR(rooms::total_energy(histogram), images(0.02, 0.9, order + 1, order, 0, 1), 1e-4 * images(0.02, 0.9, order + 1, order, 0, 1))
        << order;
    // Over time too: bins of 100 ms hold several images, at most one in a hundred lies across an edge.
    for (int tenth = 1; tenth < 10; ++tenth) {
      double sum = 0;
      for (int bin = 100 * tenth; bin < 100 * (tenth + 1); ++bin) sum += histogram.energy(bin, 0);
      const double exact = images(0.02, 0.9, order + 1, order, 0.1 * tenth, 0.1 * (tenth + 1));
      EXPECT_NEAR(sum, exact, 0.1 * exact) << order << " " << tenth;
    }
  }
}

TEST(FacingPlanes, IsTheSameWithSourceAndListenerSwapped) {
  const AcousticScene scene(flutter_room(0.02, 0.9), mirror_config(3));
  const EnergyHistogram forward = flutter(scene, source(), listener()), backward = flutter(scene, listener(), source());
  ASSERT_GT(rooms::total_energy(forward), 0);
  for (int bin = 0; bin < forward.num_bins(); ++bin)
    EXPECT_NEAR(forward.energy(bin, 0), backward.energy(bin, 0), 1e-4 * (forward.energy(bin, 0) + 1e-9));
}

TEST(FacingPlanes, KeepsNoneWhereTheDiffuseFieldCoversIt) {
  // Evenly hard walls: the flutter lasts no longer than all else; and walls that scatter.
  for (const auto& [hard, soft, scattering] : {std::array{0.1, 0.1, 0.1}, {0.3, 0.3, 0.2}, {0.02, 0.3, 0.5}}) {
    const AcousticScene scene(flutter_room(hard, soft, scattering), mirror_config(3));
    EXPECT_EQ(EarlyCandidates(scene, source()).long_chains(), nullptr) << hard << " " << soft << " " << scattering;
  }
  AcousticConfig no_images = mirror_config(3);
  no_images.early = Switch::off;
  const AcousticScene scene(flutter_room(0.02, 0.9), no_images);
  EXPECT_EQ(EarlyCandidates(scene, source()).long_chains(), nullptr);
}

TEST(FacingPlanes, AScreenInTheStripEndsTheFlutterBehindIt) {
  // A screen right across the middle of the room, from floor to ceiling but for a gap beside the line between source and listener.
  const auto with_screen = [](double from_y) {
    TriangleMesh mesh;
    rooms::append_box(mesh, {0, 0, 0}, {6, 5, 3}, 1);
    mesh.triangle_material[0] = mesh.triangle_material[1] = mesh.triangle_material[2] = mesh.triangle_material[3] = 0;
    rooms::append_quad(mesh, {rooms::point(3, from_y, 0), rooms::point(3, 5, 0), rooms::point(3, 5, 3), rooms::point(3, from_y, 3)}, 1);
    return rooms::scene_of(mesh, {Material::uniform("hard", 0.02f, 0.f), Material::uniform("soft", 0.9f, 0.f)});
  };
  AcousticConfig config = mirror_config(2);
  const AcousticScene beside(with_screen(4.0), config), across(with_screen(2.5), config);
  // Direct strip free, those by the wall y = 5 not: less than all, more than the strip alone.
  const double whole = images(0.02, 0.9, 3, 2, 0, 1), strip = images(0.02, 0.9, 3, 0, 0, 1);
  const double seen = rooms::total_energy(flutter(beside, source(), listener()));
  EXPECT_LT(seen, 0.999 * whole);
  EXPECT_GT(seen, strip);
  // The screen ends where the line is half across: short paths by the wall y = 0, which absorbs 90 %, still get round it.
  EXPECT_LT(rooms::total_energy(flutter(across, source(), listener())), 0.1 * strip);
}

/// Energy of the paths between hard walls at x = 0 and x = 6 and nothing else, of `least` to `most` bounces, that keep clear of boxes.
struct Obstacle {
  glm::dvec2 lower, upper;  ///< x, y
};
double clear_images(double hard, glm::dvec3 source, glm::dvec3 listener, Obstacle obstacle, int least, int most, double to_s) {
  double sum = 0;
  for (int n = -most; n <= most; ++n) {
    if (std::abs(n) < least) continue;
    const double image_x = n * 6.0 + (n % 2 == 0 ? source.x : 6 - source.x), rise = image_x - listener.x;
    const double r = std::hypot(rise, source.y - listener.y, source.z - listener.z);
    if (r >= rooms::kSpeedMPerS * to_s) continue;
    // The unfolded path in small steps while it is within the obstacle's y.
    bool clear = true;
    const double from = (obstacle.lower.y - listener.y) / (source.y - listener.y),
                 to = (obstacle.upper.y - listener.y) / (source.y - listener.y);
    const int steps = 1 + static_cast<int>(std::abs((to - from) * rise) / 0.002);
    for (int i = 0; i <= steps && clear; ++i) {
      const double x = listener.x + (from + (to - from) * i / steps) * rise, folded = x - 12 * std::floor(x / 12);
      const double inside = folded < 6 ? folded : 12 - folded;
      clear = !(inside > obstacle.lower.x && inside < obstacle.upper.x);
    }
    if (clear) sum += std::pow(1 - hard, std::abs(n)) * decay::direct_energy(r);
  }
  return sum;
}

/// Energies over poses: as the engine has it, and by images that keep clear of the obstacle, all, those past the traced ones, and without
/// it.
struct PastObstacle {
  double seen = 0, exact = 0, exact_late = 0, free = 0;
  void add(const AcousticScene& scene, glm::dvec3 from, glm::dvec3 to, Obstacle obstacle) {
    seen += rooms::total_energy(flutter(scene, rooms::point(from.x, from.y, from.z), rooms::point(to.x, to.y, to.z)));
    exact += clear_images(0.02, from, to, obstacle, 3, 100, 1);
    exact_late += clear_images(0.02, from, to, obstacle, FacingPlanes::kTracedBounces + 1, 100, 1);
    free += clear_images(0.02, from, to, {{9, 2.5}, {9, 2.5}}, 3, 100, 1);
  }
};

TEST(FacingPlanes, APartitionTakesItsShareOfPathsOfAnyLength) {
  // Walls x = 0 and x = 6 are hard, all else is black: from x = 0 to 2 a thin screen stands across every strip, so that a third of the
  // paths of any number of bounces is lost.
  TriangleMesh mesh;
  rooms::append_box(mesh, {0, 0, 0}, {6, 5, 3}, 1);
  for (std::size_t i = 0; i < 4; ++i) mesh.triangle_material[i] = 0;
  rooms::append_quad(mesh, {rooms::point(0, 2.5, 0), rooms::point(2, 2.5, 0), rooms::point(2, 2.5, 3), rooms::point(0, 2.5, 3)}, 1);
  const auto room = rooms::scene_of(mesh, {Material::uniform("hard", 0.02f, 0.f), Material::uniform("black", 1.f, 0.f)});
  AcousticConfig config = mirror_config(2);
  const AcousticScene scene(room, config);
  const glm::dvec3 from(3.1, 2.0, 1.4);
  const Obstacle screen{{0, 2.5}, {2, 2.5}};
  PastObstacle sum;
  for (int i = 0; i < 8; ++i) sum.add(scene, from, {2.6 + 0.37 * i, 2.8 + 0.17 * i, 1.5}, screen);
  ASSERT_GT(sum.free, 1.3 * sum.exact) << "a partition that takes nothing";
  ASSERT_GT(sum.exact_late, 0.05 * sum.exact);
  // Paths of up to 12 bounces are exact.  Of the longer ones, two of a run of four and more tell for it: of some 40 runs about a third is
  // wrong by a half and more, 15 % together.
  std::printf("partition: seen %.6g, exact %.6g, of which late %.6g, free %.6g\n", sum.seen, sum.exact, sum.exact_late, sum.free);
  EXPECT_NEAR(sum.seen, sum.exact, 0.3 * sum.exact_late + 1e-3 * sum.exact);
}

TEST(FacingPlanes, APillarInALongStripIsSeen) {
  // 0.3 m of a strip of 12 m: long paths all meet it, short ones mostly pass.
  TriangleMesh mesh;
  rooms::append_box(mesh, {0, 0, 0}, {6, 16, 3}, 1);
  for (std::size_t i = 0; i < 4; ++i) mesh.triangle_material[i] = 0;
  rooms::append_box(mesh, {2, 8.1, 0}, {4, 8.4, 3}, 1);
  const auto room = rooms::scene_of(mesh, {Material::uniform("hard", 0.02f, 0.f), Material::uniform("black", 1.f, 0.f)});
  const AcousticScene scene(room, mirror_config(2));
  const glm::dvec3 from(1.3, 2.0, 1.4);
  const Obstacle pillar{{2, 8.1}, {4, 8.4}};
  PastObstacle sum;
  for (int i = 0; i < 8; ++i) sum.add(scene, from, {0.6 + 0.57 * i, 13.3 + 0.17 * i, 1.5}, pillar);
  std::printf("pillar: seen %.6g, exact %.6g, of which late %.6g, free %.6g\n", sum.seen, sum.exact, sum.exact_late, sum.free);
  ASSERT_GT(sum.free, 1.3 * sum.exact);
  EXPECT_NEAR(sum.seen, sum.exact, 0.3 * sum.exact_late + 1e-3 * sum.exact);
}

/// Sums over seeds of all that comes late, against all images beyond the image paths: nothing twice, nothing lost.
TEST(FacingPlanes, EstimatorsLeaveOutWhatItAdds) {
  const int order = 3;
  AcousticConfig config = mirror_config(order);
  config.rays = 4096;
  config.source_radius_m = 1.2f;
  const auto room = flutter_room(0.02, 0.9);
  const double exact = images(0.02, 0.9, 0, 8, 0, 1);
  double paths = 0;
  {
    const AcousticScene scene(room, config);
    std::vector<Arrival> arrivals;
    EarlyCandidates(scene, source()).find_arrivals(scene, listener(), arrivals);
    for (const Arrival& arrival : arrivals) paths += double{arrival.amplitude[0]} * arrival.amplitude[0];
  }
  for (const int source_rays : {0, 64}) {
    config.source_rays = source_rays;
    const auto total = rooms::over_seeds(12, config, [&](const AcousticConfig& c) {
      const AcousticScene scene(room, c);
      EnergyHistogram histogram = make_histogram(scene);
      const EarlyCandidates candidates(scene, source());
      if (source_rays > 0)
        trace_bidirectional(scene, candidates, listener(), histogram);
      else
        trace_late(scene, candidates, listener(), histogram);
      return rooms::total_energy(histogram);
    });
    const double late = exact - paths;
    std::printf("flutter room, %d source rays: late energy %.5g, images %.5g +- %.2g (%.1f sigma)\n", source_rays, total.mean, late,
                total.standard_error, (total.mean - late) / total.standard_error);
    EXPECT_NEAR(total.mean, late, 4 * total.standard_error + 2e-3 * late);
    EXPECT_LT(total.standard_error, 0.01 * late);
  }
}

/// images() of at most three bounces on the other walls, without those that meet wall `left_out` (2 to 5, in the order of rooms::box).
double images_without(int left_out, double hard, double soft, int least) {
  const double size[3] = {6, 5, 3}, s[3] = {1.7, 2.0, 1.4}, l[3] = {4.1, 2.9, 1.6};
  const auto offset = [&](int axis, int n) { return n * size[axis] + (n % 2 == 0 ? s[axis] : size[axis] - s[axis]) - l[axis]; };
  const int axis = left_out / 2, away = left_out % 2 == 0 ? 1 : -1;
  double sum = 0;
  for (int x = -100; x <= 100; ++x)
    for (int y = -3; y <= 3; ++y)
      for (int z = -3; z <= 3; ++z) {
        const int n = axis == 1 ? y : z;
        if (std::abs(x) < least || std::abs(y) + std::abs(z) > 3 || (n != 0 && n != away)) continue;
        const double r = std::hypot(offset(0, x), offset(1, y), offset(2, z));
        if (r < rooms::kSpeedMPerS)
          sum += std::pow(1 - hard, std::abs(x)) * std::pow(1 - soft, std::abs(y) + std::abs(z)) * decay::direct_energy(r);
      }
  return sum;
}

// A wall that reflects by the angle takes no part; the row between the other two stays, with the sides that are left.  As precise as the
// row without such a wall.
TEST(FacingPlanes, LeaveOutOnlyWallsThatReflectByTheAngle) {
  for (std::uint32_t number = 0; number < 12; ++number) {
    const RandomStream random(513, Purpose::test, number);
    const int wall = static_cast<int>(number) % 6;
    const double hard = 0.01 + 0.03 * double{random.uniform(0)}, soft = 0.5 + 0.4 * double{random.uniform(1)};
    std::array<Material, 6> walls = rooms::uniform_walls(soft, 0);
    for (std::size_t i = 0; i < 2; ++i) walls[i] = rooms::uniform_walls(hard, 0)[0];
    walls[static_cast<std::size_t>(wall)].locally_reacting = true;
    const AcousticScene scene(rooms::box(6, 5, 3, walls), mirror_config(3));
    const FacingPlanes planes(scene, source());
    ASSERT_EQ(planes.size(), wall < 2 ? 0u : 1u) << wall;
    if (wall < 2) continue;
    EnergyHistogram histogram = make_histogram(scene);
    planes.add_late(scene, listener(), histogram);
    const double exact = images_without(wall, hard, soft, 4);
    EXPECT_NEAR(rooms::total_energy(histogram), exact, 1e-4 * exact) << wall;
  }
}

}  // namespace
}  // namespace earshot
