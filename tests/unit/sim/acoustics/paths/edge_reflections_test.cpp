// SPDX-License-Identifier: Apache-2.0
#include "sim/acoustics/paths/edge_reflections.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <complex>
#include <numbers>

#include "sim/acoustics/response/energy_response.h"
#include "sim/base/random.h"
#include "tests/support/acoustics/coherent_field.h"
#include "tests/support/acoustics/finite_wedge.h"
#include "tests/support/acoustics/rooms.h"

namespace earshot {
namespace {

using coherent_field::arrivals_of;
using coherent_field::pressure;
using Complex = std::complex<double>;
constexpr double kTop = 2.0;

AcousticConfig config_with(int reflections) {
  AcousticConfig config = coherent_field::config_with(Switch::on);
  config.diffraction_reflections = reflections;
  return config;
}

/// A thin screen of 2 m at x = 0 on a hard floor, both 400 m long.
std::shared_ptr<const Scene> screen_on_floor(float absorption = 0.f) {
  TriangleMesh mesh;
  const double far = 200;
  rooms::append_quad(mesh, {rooms::point(-far, -far, 0), rooms::point(far, -far, 0), rooms::point(far, far, 0), rooms::point(-far, far, 0)},
                     1);
  rooms::append_quad(mesh, {rooms::point(0, -far, 0), rooms::point(0, far, 0), rooms::point(0, far, kTop), rooms::point(0, -far, kTop)}, 0);
  return rooms::scene_of(mesh, {Material::uniform("hard", 0.f, 0.f), Material::uniform("floor", absorption, 0.f)});
}

/// Over the top edge, as a half plane in the free field: y along the edge, angles from the screen.
Complex over_the_top(glm::dvec3 source, glm::dvec3 listener, double wavenumber) {
  const auto cylindrical = [](glm::dvec3 p) {
    double angle = std::atan2(p.x, kTop - p.z);  // 0: down the screen, toward +x
    if (angle < 0) angle += 2 * std::numbers::pi;
    return finite_wedge::Point{std::hypot(p.x, p.z - kTop), angle, p.y};
  };
  // In pieces: the integral has a fixed number of points.
  constexpr std::array<double, 10> ends = {-200, -100, -50, -20, -5, 5, 20, 50, 100, 200};
  Complex sum = 0;
  for (std::size_t i = 0; i + 1 < ends.size(); ++i)
    sum += finite_wedge::line_integral(2 * std::numbers::pi, cylindrical(source), cylindrical(listener), ends[i], ends[i + 1], wavenumber);
  return sum;
}

TEST(EdgeReflections, AScreenOnAHardFloorIsTheSumOfFourInTheFreeField) {
  // Source and image by listener and image, each over the top edge by Biot-Tolstoy-Medwin: the strip of twice the height, in two halves.
  struct Pose {
    glm::dvec3 source, listener;
  };
  const std::array<double, 2> absorption = {0.0, 0.75};
  const std::array<AcousticScene, 2> scenes = {AcousticScene(screen_on_floor(0.f), config_with(1)),
                                               AcousticScene(screen_on_floor(0.75f), config_with(1))};
  for (const Pose& pose : {Pose{{3, 0, 1.2}, {-4, 0.5, 1.0}}, Pose{{2, 0, 0.5}, {-3, 1, 1.5}}, Pose{{6, 0, 1.5}, {-2, -3, 0.3}}}) {
    const glm::vec3 source = rooms::point(pose.source.x, pose.source.y, pose.source.z),
                    listener = rooms::point(pose.listener.x, pose.listener.y, pose.listener.z);
    const glm::dvec3 down(1, 1, -1);
    for (std::size_t band = 0; band < static_cast<std::size_t>(scenes[0].num_bands()); ++band) {
      const double k = 2 * std::numbers::pi * scenes[0].bands().centre_hz[band] / scenes[0].speed_of_sound_m_per_s();
      const std::array<Complex, 4> free = {over_the_top(pose.source, pose.listener, k), over_the_top(pose.source * down, pose.listener, k),
                                           over_the_top(pose.source, pose.listener * down, k),
                                           over_the_top(pose.source * down, pose.listener * down, k)};
      for (std::size_t i = 0; i < 2; ++i) {
        const double floor = std::sqrt(1 - absorption[i]);
        const std::array<double, 4> factor = {1, floor, floor, floor * floor};
        Complex four = 0;
        double largest = 0;
        for (std::size_t term = 0; term < 4; ++term) four += factor[term] * free[term], largest += factor[term] * std::abs(free[term]);
        const auto arrivals = arrivals_of(scenes[i], source, listener);
        ASSERT_EQ(arrivals.size(), 4u);
        const Complex ours = pressure(scenes[i], arrivals, band);
        // 0.1 dB of the four's sum in phase: where they cancel, the ratio of two small numbers says nothing.
        EXPECT_LT(std::abs(ours - four), 0.0116 * largest) << absorption[i] << " band " << band;
        if (std::abs(four) > 0.5 * largest) {
          EXPECT_NEAR(20 * std::log10(std::abs(ours / four)), 0, 0.1) << absorption[i] << " band " << band;
        }
      }
    }
  }
}

TEST(EdgeReflections, OffGivesTheEdgesAloneAndTheSameLateField) {
  AcousticConfig off = config_with(0), on = config_with(1);
  off.late = on.late = Switch::on;
  off.rays = on.rays = 64;
  const auto geometry = screen_on_floor(0.1f);
  const AcousticScene without(geometry, off), with(geometry, on);
  EXPECT_NE(without.hash(), with.hash());
  const glm::vec3 source = rooms::point(3, 0, 1.2), listener = rooms::point(-4, 0.5, 1.0);
  EnergyResponse a, b;
  compute_energy_response(without, EarlyCandidates(without, source), listener, a);
  compute_energy_response(with, EarlyCandidates(with, source), listener, b);
  ASSERT_EQ(a.arrivals.size(), 1u);
  ASSERT_EQ(b.arrivals.size(), 4u);
  EXPECT_EQ(a.arrivals[0].identity, b.arrivals[0].identity);
  EXPECT_EQ(a.arrivals[0].amplitude, b.arrivals[0].amplitude);
  for (std::size_t i = 0; i < 4; ++i)
    for (std::size_t j = 0; j < i; ++j) EXPECT_NE(b.arrivals[i].identity, b.arrivals[j].identity);
  ASSERT_EQ(a.late.num_bins(), b.late.num_bins());
  for (int bin = 0; bin < a.late.num_bins(); ++bin)
    for (int band = 0; band < a.late.num_bands(); ++band) ASSERT_EQ(a.late.energy(bin, band), b.late.energy(bin, band));
}

TEST(EdgeReflections, SwappedEndsGiveTheSameBits) {
  // A box on the floor of a room: single edges, so that both ends find the same.
  TriangleMesh mesh;
  rooms::append_box(mesh, {0, 0, 0}, {7, 6, 3}, 0);
  rooms::append_box(mesh, {3, 1.5, 0}, {4, 4.5, 1.8}, 0);
  AcousticConfig config = config_with(1);
  config.diffraction_order = 1;
  config.diffraction_paths = 200;
  const AcousticScene scene(rooms::scene_of(mesh, {Material::uniform("wall", 0.1f, 0.1f)}), config);
  int mixed = 0;
  for (std::uint32_t i = 0; i < 20; ++i) {
    const RandomStream random(7, Purpose::test, i);
    const glm::vec3 a = rooms::point(0.3 + 2.5 * random.uniform(0), 0.3 + 5.4 * random.uniform(1), 0.3 + random.uniform(2)),
                    b = rooms::point(4.3 + 2.5 * random.uniform(3), 0.3 + 5.4 * random.uniform(4), 0.3 + random.uniform(5));
    const auto forth = arrivals_of(scene, a, b), back = arrivals_of(scene, b, a);
    ASSERT_EQ(forth.size(), back.size());
    for (const Arrival& arrival : forth) {
      if (arrival.kind != ArrivalKind::diffraction) continue;
      const auto same = std::find_if(back.begin(), back.end(), [&](const Arrival& other) {
        return other.amplitude == arrival.amplitude && other.phase_rad == arrival.phase_rad && other.distance_m == arrival.distance_m &&
               other.direction == arrival.departure && other.departure == arrival.direction;
      });
      EXPECT_NE(same, back.end());
      mixed += arrival.order > 1 ? 1 : 0;
    }
  }
  EXPECT_GT(mixed, 40);
}

TEST(EdgeReflections, LevelFollowsAListenerOutOfTheShadow) {
  // Rising behind the screen: the floor's image of the source comes into sight after the source itself.  No step above 1 dB, in either.
  const AcousticScene scene(screen_on_floor(), config_with(1));
  const glm::vec3 source = rooms::point(3, 0, 1.2);
  const EarlyCandidates candidates(scene, source);
  EnergyResponse response;
  int in_sight = 0, with_image = 0;
  double largest_db = 0;
  std::vector<double> last;
  for (int step = 0; step < 500; ++step) {
    compute_energy_response(scene, candidates, rooms::point(-2, 0.3, 1.0033 + 0.01 * step), response);
    in_sight += response.arrivals[0].kind == ArrivalKind::direct ? 1 : 0;
    for (const Arrival& arrival : response.arrivals)
      with_image += arrival.kind == ArrivalKind::reflection && arrival.direction.y < 0 && arrival.order == 1 ? 1 : 0;
    std::vector<double> energy;
    for (std::size_t band = 0; band < 4; ++band) {
      double sum = 0;
      for (const Arrival& arrival : response.arrivals) sum += double{arrival.amplitude[band]} * arrival.amplitude[band];
      energy.push_back(sum);
    }
    for (std::size_t band = 0; band < last.size(); ++band)
      largest_db = std::max(largest_db, std::abs(10 * std::log10(energy[band] / last[band])));
    last = energy;
  }
  EXPECT_GT(in_sight, 100);
  EXPECT_LT(in_sight, 480);
  EXPECT_GT(with_image, 20);
  EXPECT_LT(largest_db, 1.0);
}

}  // namespace
}  // namespace earshot
