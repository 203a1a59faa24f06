// SPDX-License-Identifier: Apache-2.0
#include "sim/acoustics/response/sphere_arrivals.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <numbers>
#include <vector>

#include "sim/acoustics/response/energy_response.h"
#include "sim/base/random.h"
#include "tests/support/acoustics/rooms.h"

namespace earshot {
namespace {

constexpr double kPi = std::numbers::pi;
constexpr std::uint32_t kDraws = 24;

AcousticConfig direct_only(Switch diffraction, int direct_rays = 64) {
  AcousticConfig config;
  config.early = config.late = Switch::off;
  config.diffraction = diffraction;
  config.transmission = Switch::off;
  config.rir_length_s = 0.06f;  // 21 m: the far edges of the screen, 30 m out, bring nothing
  config.direct_rays = direct_rays;
  return config;
}

/// A sphere and a listener on two sides of a half plane in a general position.
struct Place {
  glm::dvec3 source, listener, along, across;  ///< across: unit, from the line of sight to the screen; along: unit, of its edge
  double radius_m, distance_m;
  double height_m;  ///< of the edge over the line from listener to centre
  double part;      ///< of the way from listener to source at which the screen is
  std::shared_ptr<const Scene> scene;

  /// edge_radii: where the edge lies on the disc that the sphere is from the listener, in radii from its centre.
  Place(std::uint32_t number, double edge_radii, const Material& material = Material::uniform("screen", 0.3f, 0.2f)) {
    const RandomStream random(381, Purpose::test, number);
    const auto draw = [&](std::uint32_t i) { return double{random.uniform(i)}; };
    listener = {4 * draw(0), 4 * draw(1), 4 * draw(2)};
    const double z = 2 * draw(3) - 1, turn = 2 * kPi * draw(4), flat = std::sqrt(1 - z * z);
    const glm::dvec3 axis(flat * std::cos(turn), flat * std::sin(turn), z);
    distance_m = 3 + 5 * draw(5);
    radius_m = 0.2 + 1.0 * draw(6);
    source = listener + distance_m * axis;
    const glm::dvec3 any = std::abs(axis.x) < 0.6 ? glm::dvec3(1, 0, 0) : glm::dvec3(0, 1, 0);
    const glm::dvec3 x = glm::normalize(glm::cross(axis, any)), y = glm::cross(axis, x);
    across = std::cos(2 * kPi * draw(7)) * x + std::sin(2 * kPi * draw(7)) * y;
    along = glm::cross(axis, across);
    part = 0.25 + 0.5 * draw(8);
    height_m = edge_radii * radius_m * part;
    const glm::dvec3 edge = listener + part * (source - listener) + height_m * across;
    TriangleMesh mesh;
    const auto corner = [&](double s, double t) { return glm::vec3(edge + s * along + t * across); };
    rooms::append_quad(mesh, {corner(-30, 0), corner(30, 0), corner(30, 30), corner(-30, 30)}, 0);
    scene = rooms::scene_of(std::move(mesh), {material});
  }
  [[nodiscard]] SoundSource sphere() const {
    SoundSource sound{glm::vec3(source)};
    sound.radius_m = static_cast<float>(radius_m);
    return sound;
  }
};

/// Fraction of a unit disc with x < edge: a circular segment.
double segment(double edge) {
  const double t = std::clamp(edge, -1.0, 1.0);
  return 0.5 + (std::asin(t) + t * std::sqrt(1 - t * t)) / kPi;
}

EnergyResponse respond(const AcousticScene& scene, const SoundSource& source, glm::dvec3 listener) {
  EnergyResponse response;
  compute_energy_response(scene, EarlyCandidates(scene, source), glm::vec3(listener), response);
  return response;
}

double energy_of(const EnergyResponse& response, int band) {
  double sum = 0;
  for (const Arrival& arrival : response.arrivals)
    sum += double{arrival.amplitude[static_cast<std::size_t>(band)]} * double{arrival.amplitude[static_cast<std::size_t>(band)]};
  return sum;
}

double free_energy(const AcousticScene& scene, double distance_m, int band) {
  const double air = std::exp(-double{scene.air_energy_per_m()[static_cast<std::size_t>(band)]} * distance_m);
  return air / (16 * kPi * kPi * distance_m * distance_m);
}

// The circular segment.  64 points differ from it by at most 0.044 over all half planes (a scan of 18,000), by 0.012 in the root mean
// square; 1024 points by a sixteenth to the power of 3/4 of that, an eighth.
TEST(SphereArrivals, BehindAnEdgeTheVisibleSegmentIsHeard) {
  for (const auto& [rays, most, most_rms] : {std::tuple{64, 0.05, 0.02}, std::tuple{1024, 0.01, 0.004}}) {
    double square = 0;
    for (std::uint32_t number = 0; number < kDraws; ++number) {
      const double edge = -1.2 + 2.4 * double{RandomStream(7, Purpose::test, number).uniform(0)};
      const Place place(number, edge);
      const AcousticScene scene(place.scene, direct_only(Switch::off, rays));
      const EnergyResponse response = respond(scene, place.sphere(), place.listener);
      ASSERT_LE(response.arrivals.size(), 1u);
      const double fraction = energy_of(response, 3) / free_energy(scene, place.distance_m, 3);
      EXPECT_NEAR(fraction, segment(edge), most) << number << " edge at " << edge;
      square += (fraction - segment(edge)) * (fraction - segment(edge));
      EXPECT_EQ(response.effects.in_sight, fraction > 0 ? 1u : 0u);
    }
    EXPECT_LT(std::sqrt(square / kDraws), most_rms) << rays;
  }
}

// From the centroid of the visible segment: the sum of the unit vectors to it, by a grid over the disc that shares nothing with the engine.
TEST(SphereArrivals, SoundComesFromTheVisiblePart) {
  for (std::uint32_t number = 0; number < kDraws; ++number) {
    const double edge = -0.6 + 1.6 * double{RandomStream(8, Purpose::test, number).uniform(0)};
    const Place place(number, edge);
    const AcousticScene scene(place.scene, direct_only(Switch::off, 1024));
    const EnergyResponse response = respond(scene, place.sphere(), place.listener);
    ASSERT_EQ(response.arrivals.size(), 1u) << edge;
    glm::dvec3 sum(0);
    constexpr int cells = 400;
    for (int i = 0; i < cells; ++i) {
      for (int j = 0; j < cells; ++j) {
        const double s = -1 + 2 * (i + 0.5) / cells, t = -1 + 2 * (j + 0.5) / cells;
        if (s * s + t * t > 1 || t > edge) continue;
        sum += glm::normalize(place.source + place.radius_m * (s * place.along + t * place.across) - place.listener);
      }
    }
    const glm::dvec3 found(response.arrivals[0].direction), wanted = glm::normalize(sum);
    // An eighth of the spacing of 64 points in a part of at least 0.14 of the disc; the whole offset is up to 0.7 radii.
    EXPECT_LT(glm::length(found - wanted), 0.03 * place.radius_m / place.distance_m) << number << " edge at " << edge;
    EXPECT_NEAR(double{response.arrivals[0].distance_m}, place.distance_m, 1e-5 * place.distance_m);
    EXPECT_LT(glm::length(glm::dvec3(response.arrivals[0].departure) + found), 1e-6);
  }
}

// With diffraction: the mean of the energies of point sources over the disc, each by the uniform theory.  No part of the energy counts
// twice, as direct sound and as sound round the edge.  Two quadratures of a field that is smooth over a Fresnel zone, 64 and 192 points: 5
// % of the energy, 0.2 dB, and where the edge cuts the disc sharply, in high bands, 0.02 of the free field.
TEST(SphereArrivals, WithDiffractionItIsTheMeanOfPointSources) {
  for (std::uint32_t number = 0; number < 12; ++number) {
    const double edge = -2 + 4 * double{RandomStream(9, Purpose::test, number).uniform(0)};
    const Place place(number, edge);
    const AcousticScene scene(place.scene, direct_only(Switch::on));
    const EnergyResponse response = respond(scene, place.sphere(), place.listener);
    std::vector<double> mean(static_cast<std::size_t>(scene.num_bands()), 0.0);
    constexpr int rings = 8, turns = 24;
    for (int ring = 0; ring < rings; ++ring) {
      for (int turn = 0; turn < turns; ++turn) {
        const double r = place.radius_m * std::sqrt((ring + 0.5) / rings), angle = 2 * kPi * (turn + 0.5 * (ring % 2)) / turns;
        const glm::dvec3 ray = place.source + r * (std::cos(angle) * place.along + std::sin(angle) * place.across) - place.listener;
        const SoundSource point{glm::vec3(place.listener + ray * (place.distance_m / glm::length(ray)))};
        const EnergyResponse of_point = respond(scene, point, place.listener);
        for (std::size_t band = 0; band < mean.size(); ++band) mean[band] += energy_of(of_point, static_cast<int>(band)) / (rings * turns);
      }
    }
    for (int band = 0; band < scene.num_bands(); ++band) {
      const double wanted = mean[static_cast<std::size_t>(band)];
      EXPECT_NEAR(energy_of(response, band), wanted, 0.05 * wanted + 0.02 * free_energy(scene, place.distance_m, band))
          << number << " edge at " << edge << " band " << band;
    }
  }
}

// Over the boundary in steps of a fiftieth of the radius: no step is larger than the sphere's part in it and the spacing of its points.
// With diffraction the change is as wide as a Fresnel zone; on the boundary of a point a quarter of the energy is left.
TEST(SphereArrivals, LevelIsSmoothAcrossTheShadowBoundary) {
  for (const Switch diffraction : {Switch::off, Switch::on}) {
    for (std::uint32_t number = 0; number < 10; ++number) {
      double before = -1, first = 0, last = 0;
      constexpr int steps = 120;
      for (int step = 0; step <= steps; ++step) {
        const double edge = 1.2 - 2.4 * step / steps;
        const Place place(number, edge);
        const AcousticScene scene(place.scene, direct_only(diffraction));
        const double fraction = energy_of(respond(scene, place.sphere(), place.listener), 4) / free_energy(scene, place.distance_m, 4);
        // The segment changes by at most 2 / pi times the step, 0.013; three points of 64 beside that.
        if (before >= 0) {
          EXPECT_LT(std::abs(fraction - before), 0.013 + 3.0 / 64) << number << " edge at " << edge;
        }
        if (step == 0) first = fraction;
        last = before = fraction;
      }
      EXPECT_GT(first, diffraction == Switch::off ? 0.999 : 0.25);
      EXPECT_LT(last, diffraction == Switch::off ? 1e-9 : 0.25);
    }
  }
}

TEST(SphereArrivals, InFullSightItIsTheCentre) {
  for (std::uint32_t number = 0; number < kDraws; ++number) {
    const Place place(number, 1.5 + number);
    const AcousticScene scene(place.scene, direct_only(Switch::off, 2 + static_cast<int>(number) * 7));
    const EnergyResponse sphere = respond(scene, place.sphere(), place.listener);
    const EnergyResponse point = respond(scene, SoundSource(glm::vec3(place.source)), place.listener);
    ASSERT_EQ(sphere.arrivals.size(), 1u);
    const Arrival &a = sphere.arrivals[0], &b = point.arrivals[0];
    EXPECT_NEAR(a.distance_m, b.distance_m, 2e-6f * b.distance_m);
    EXPECT_LT(glm::length(a.direction - b.direction), 1e-6f);
    for (std::size_t band = 0; band < static_cast<std::size_t>(scene.num_bands()); ++band)
      EXPECT_NEAR(a.amplitude[band], b.amplitude[band], 4e-6f * b.amplitude[band]);
    EXPECT_EQ(a.identity, b.identity);
  }
}

TEST(SphereArrivals, OneRayIsTheCentreAndThreadsChangeNoBit) {
  for (std::uint32_t number = 0; number < 10; ++number) {
    const Place place(number, -1 + 0.2 * number);
    for (const int rays : {0, 1}) {
      const AcousticScene scene(place.scene, direct_only(Switch::on, rays));
      const EnergyResponse sphere = respond(scene, place.sphere(), place.listener);
      const EnergyResponse point = respond(scene, SoundSource(glm::vec3(place.source)), place.listener);
      ASSERT_EQ(sphere.arrivals.size(), point.arrivals.size());
      for (std::size_t i = 0; i < sphere.arrivals.size(); ++i) EXPECT_EQ(sphere.arrivals[i].amplitude, point.arrivals[i].amplitude);
    }
    std::vector<EnergyResponse> responses;
    for (const int threads : {1, 3, 0}) {
      AcousticConfig config = direct_only(Switch::on);
      config.threads = threads;
      responses.push_back(respond(AcousticScene(place.scene, config), place.sphere(), place.listener));
    }
    for (const EnergyResponse& other : responses) {
      ASSERT_EQ(other.arrivals.size(), responses[0].arrivals.size());
      for (std::size_t i = 0; i < other.arrivals.size(); ++i) {
        EXPECT_EQ(other.arrivals[i].amplitude, responses[0].arrivals[i].amplitude);
        EXPECT_EQ(other.arrivals[i].direction, responses[0].arrivals[i].direction);
      }
    }
  }
}

// Hidden parts come through a wall that lets sound through, with its fraction; visible ones past it: v + (1 - v) tau.
TEST(SphereArrivals, HiddenPartsComeThroughTheWall) {
  for (std::uint32_t number = 0; number < kDraws; ++number) {
    const RandomStream random(10, Purpose::test, number);
    const double edge = -1.1 + 2.2 * double{random.uniform(0)}, tau = 0.05 + 0.5 * double{random.uniform(1)};
    const Place place(number, edge, Material::uniform("leaky", 0.8f, 0.2f, static_cast<float>(tau)));
    AcousticConfig config = direct_only(Switch::off);
    config.transmission = Switch::on;
    const AcousticScene scene(place.scene, config);
    const EnergyResponse response = respond(scene, place.sphere(), place.listener);
    ASSERT_EQ(response.arrivals.size(), 1u);
    const double visible = segment(edge), wanted = visible + (1 - visible) * tau;
    EXPECT_NEAR(energy_of(response, 2) / free_energy(scene, place.distance_m, 2), wanted, 0.05 * (1 - tau)) << number;
  }
}

// In the shadow a quarter of the points stands for all: evenly over the disc, so that a patch of the wall which covers a fraction of it has
// that fraction.  Eight pairs: each fraction is within an eighth, and the mean over the draws has an error of 0.006.
TEST(SphereArrivals, PointsInTheShadowAreEvenOverTheDisc) {
  double sum = 0;
  constexpr std::uint32_t draws = 40;
  for (std::uint32_t number = 0; number < draws; ++number) {
    const double fraction = 0.1 + 0.8 * double{RandomStream(52, Purpose::test, number).uniform(0)};
    const Place place(number, 0);
    // A polygon of 48 sides with the area of the circle, in a wide ring.
    constexpr int sides = 48;
    const double radius_m = place.radius_m * place.part * std::sqrt(fraction * 2 * kPi / (sides * std::sin(2 * kPi / sides)));
    const glm::dvec3 middle = place.listener + place.part * (place.source - place.listener);
    const auto at = [&](double r, int i) {
      return glm::vec3(middle + r * (std::cos(2 * kPi * i / sides) * place.along + std::sin(2 * kPi * i / sides) * place.across));
    };
    TriangleMesh mesh;
    for (int i = 0; i < sides; ++i) {
      rooms::append_quad(mesh, {at(0, i), at(radius_m, i), 0.5f * (at(radius_m, i) + at(radius_m, i + 1)), at(radius_m, i + 1)}, 0);
      rooms::append_quad(mesh, {at(radius_m, i), at(30, i), at(30, i + 1), at(radius_m, i + 1)}, 1);
    }
    AcousticConfig config = direct_only(Switch::off);
    config.transmission = Switch::on;
    const AcousticScene scene(
        rooms::scene_of(std::move(mesh), {Material::uniform("patch", 0.8f, 0.2f, 0.6f), Material::uniform("ring", 0.8f, 0.2f, 0.1f)}),
        config);
    const EnergyResponse response = respond(scene, place.sphere(), place.listener);
    ASSERT_EQ(response.arrivals.size(), 1u);
    const double found = (energy_of(response, 2) / free_energy(scene, place.distance_m, 2) - 0.1) / 0.5;
    EXPECT_NEAR(found, fraction, 0.13) << number;
    sum += found - fraction;
  }
  EXPECT_NEAR(sum / draws, 0, 0.02);
}

TEST(SphereArrivals, NoneWhereNothingOfThemIsHeard) {
  const Place place(0, 0, Material::uniform("leaky", 0.8f, 0.2f, 0.1f));
  for (const bool direct : {false, true})
    for (const bool diffraction : {false, true})
      for (const bool transmission : {false, true}) {
        AcousticConfig config = direct_only(diffraction ? Switch::on : Switch::off);
        config.direct = direct ? Switch::on : Switch::off;
        config.transmission = transmission ? Switch::on : Switch::off;
        EXPECT_EQ(is_sphere(AcousticScene(place.scene, config), place.sphere(), glm::vec3(place.listener)),
                  direct || diffraction || transmission);
      }
}

}  // namespace
}  // namespace earshot
