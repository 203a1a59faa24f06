// SPDX-License-Identifier: Apache-2.0
// Walls whose reflection depends on the angle, against plane-wave reflection and against the images of boxes.

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <complex>
#include <numbers>

#include "sim/acoustics/response/energy_response.h"
#include "sim/acoustics/source_field/source_field.h"
#include "sim/scene/materials/wall_impedance.h"
#include "tests/support/acoustics/rooms.h"
#include "tests/support/draws.h"

namespace earshot {
namespace {

constexpr std::uint64_t kSeed = 39;  // of what is drawn

using Complex = std::complex<double>;
using rooms::point;

Material impedance_wall(Complex impedance, double scattering = 0) {
  Material wall = Material::uniform("wall", static_cast<float>(random_incidence_absorption(impedance)), static_cast<float>(scattering));
  wall.locally_reacting = true;
  wall.impedance_real = CoefficientCurve::constant(static_cast<float>(impedance.real()));
  wall.impedance_imaginary = CoefficientCurve::constant(static_cast<float>(impedance.imag()));
  return wall;
}

AcousticConfig without_other_effects() {
  AcousticConfig config;
  config.air_absorption = config.wall_power = config.diffraction = Switch::off;
  return config;
}

EnergyResponse response_of(const AcousticScene& scene, glm::vec3 source, glm::vec3 listener, const SourceField* field = nullptr) {
  EnergyResponse response;
  compute_energy_response(scene, EarlyCandidates(scene, source), field, listener, response);
  return response;
}

// Single precision of the coefficients: 1e-5.
TEST(LocallyReacting, AnImageHasThePressureOfAPlaneWaveAtItsAngle) {
  for (std::uint32_t number = 0; number < 14; ++number) {
    Draws draw(kSeed, number);
    const Complex impedance = std::polar(std::pow(10.0, draw.within(-0.5, 1.5)), draw.within(-1.4, 1.4));
    const double source_m = std::pow(10.0, draw.within(-1, 1)), listener_m = std::pow(10.0, draw.within(-1, 1)),
                 apart_m = draw.within(0.5, 30), scattering = draw.within(0, 0.5);
    TriangleMesh mesh;
    rooms::append_quad(mesh, {point(-200, -200, 0), point(200, -200, 0), point(200, 200, 0), point(-200, 200, 0)}, 0);
    const AcousticScene scene(rooms::scene_of(std::move(mesh), {impedance_wall(impedance, scattering)}), without_other_effects());
    const EnergyResponse response = response_of(scene, point(0, 0, source_m), point(apart_m, 0, listener_m));
    const auto image = std::ranges::find(response.arrivals, ArrivalKind::reflection, &Arrival::kind);
    ASSERT_NE(image, response.arrivals.end());
    const double distance_m = std::hypot(apart_m, source_m + listener_m), cosine = (source_m + listener_m) / distance_m;
    const Complex expected =
        (impedance * cosine - 1.0) / (impedance * cosine + 1.0) * std::sqrt(1 - scattering) / (4 * std::numbers::pi * distance_m);
    for (std::size_t band = 0; band < static_cast<std::size_t>(scene.num_bands()); ++band) {
      const Complex found = std::polar(double{image->amplitude[band]}, double{image->phase_rad[band]});
      EXPECT_LT(std::abs(found - expected), 2e-5 * std::abs(expected) + 1e-9) << number << ", band " << band;
    }
  }
}

// By Paris' formula from the absorption alone: real, and at grazing incidence -1.
TEST(LocallyReacting, AnAbsorptionGivesARealImpedance) {
  for (std::uint32_t number = 0; number < 10; ++number) {
    Draws draw(kSeed, 100 + number);
    const double absorption = draw.within(0.02, 0.99), height_m = draw.within(0.1, 5), apart_m = draw.within(1, 60);
    TriangleMesh mesh;
    rooms::append_quad(mesh, {point(-200, -200, 0), point(200, -200, 0), point(200, 200, 0), point(-200, 200, 0)}, 0);
    Material wall = Material::uniform("wall", static_cast<float>(absorption), 0.f);
    wall.locally_reacting = true;
    const AcousticScene scene(rooms::scene_of(std::move(mesh), {wall}), without_other_effects());
    const EnergyResponse response = response_of(scene, point(0, 0, height_m), point(apart_m, 0, height_m));
    const auto image = std::ranges::find(response.arrivals, ArrivalKind::reflection, &Arrival::kind);
    ASSERT_NE(image, response.arrivals.end());
    const double distance_m = std::hypot(apart_m, 2 * height_m), cosine = 2 * height_m / distance_m;
    const double real = impedance_of_absorption(absorption), reflection = (real * cosine - 1) / (real * cosine + 1);
    const double kept = absorption > kLargestLocalAbsorption ? std::sqrt((1 - absorption) / (1 - kLargestLocalAbsorption)) : 1;
    EXPECT_NEAR(double{image->amplitude[2]} * 4 * std::numbers::pi * distance_m, kept * std::abs(reflection), 1e-4) << absorption;
    EXPECT_NEAR(std::cos(double{image->phase_rad[2]}), reflection < 0 ? -1.0 : 1.0, 1e-9);
  }
}

/// Energy of all images of a box within `reach_m` but the source itself, by walls of these impedances in the order of rooms::box; random:
/// every reflection keeps what it does at random incidence.
double energy_of_images(glm::dvec3 size, const std::array<Complex, 6>& impedance, glm::dvec3 from, glm::dvec3 to, double reach_m,
                        bool random) {
  const auto kept = [&](int wall, double cosine) {
    const Complex z = impedance[static_cast<std::size_t>(wall)];
    return random ? 1 - random_incidence_absorption(z) : std::norm((z * cosine - 1.0) / (z * cosine + 1.0));
  };
  const glm::ivec3 most(glm::ceil(reach_m / size) + 1.0);
  double sum = 0;
  for (int x = -most.x; x <= most.x; ++x)
    for (int y = -most.y; y <= most.y; ++y)
      for (int z = -most.z; z <= most.z; ++z) {
        const glm::ivec3 n(x, y, z);
        glm::dvec3 way;
        for (int axis = 0; axis < 3; ++axis)
          way[axis] = n[axis] * size[axis] + (n[axis] % 2 == 0 ? from[axis] : size[axis] - from[axis]) - to[axis];
        const double distance_m = glm::length(way);
        if (distance_m > reach_m || n == glm::ivec3(0)) continue;
        double energy = 1 / (16 * std::numbers::pi * std::numbers::pi * distance_m * distance_m);
        for (int axis = 0; axis < 3; ++axis) {
          // Of |n| walls in turn the larger half is that on the side of the image.
          const int first = (std::abs(n[axis]) + 1) / 2, second = std::abs(n[axis]) / 2, near = n[axis] > 0 ? 1 : 0;
          const double cosine = std::abs(way[axis]) / distance_m;
          energy *= std::pow(kept(2 * axis + near, cosine), first) * std::pow(kept(2 * axis + 1 - near, cosine), second);
        }
        sum += energy;
      }
  return sum;
}

/// Without the direct sound.
double energy_of(const EnergyResponse& response, int band) {
  double sum = 0;
  for (const Arrival& arrival : response.arrivals)
    if (arrival.kind != ArrivalKind::direct)
      sum += double{arrival.amplitude[static_cast<std::size_t>(band)]} * double{arrival.amplitude[static_cast<std::size_t>(band)]};
  for (int bin = 0; bin < response.late.num_bins(); ++bin) sum += double{response.late.energy(bin, band)};
  return sum;
}

/// A box of mirrors of drawn impedances; the energy of both tracers and of a source field.
struct MirrorBox {
  glm::dvec3 size, from, to;
  std::array<Complex, 6> impedance;
  explicit MirrorBox(std::uint32_t number) {
    Draws draw(kSeed, 200 + number);
    size = {draw.within(4, 7), draw.within(3.5, 5), draw.within(2.6, 4)};
    from = size * glm::dvec3(draw.within(0.2, 0.45), draw.within(0.2, 0.8), draw.within(0.3, 0.6));
    to = size * glm::dvec3(draw.within(0.55, 0.8), draw.within(0.2, 0.8), draw.within(0.3, 0.7));
    for (Complex& z : impedance) z = Complex(std::pow(10.0, draw.within(0.2, 0.9)), draw.within(-4, 4));
  }
};

// Every chain of mirrors at its own angles.  The source volume and the rays leave 0.1 dB in rooms of mirrors; 0.4 dB.  Walls that reflect
// as at random incidence are off by 0.5 to 3 dB.
TEST(LocallyReacting, RoomsOfMirrorsHaveTheEnergyOfTheirImages) {
  double angle_matters_db = 0;
  for (std::uint32_t number = 0; number < 10; ++number) {
    const MirrorBox box(number);
    std::array<Material, 6> walls;
    for (std::size_t i = 0; i < 6; ++i) walls[i] = impedance_wall(box.impedance[i]);
    AcousticConfig config = without_other_effects();
    config.bands = 1;
    config.rir_length_s = 0.25f;
    config.rays = 8192;
    config.diffuse_last_segment = false;
    config.field = Switch::off;
    const double expected = energy_of_images(box.size, box.impedance, box.from, box.to, 0.25 * rooms::kSpeedMPerS, false);
    const double at_random = energy_of_images(box.size, box.impedance, box.from, box.to, 0.25 * rooms::kSpeedMPerS, true);
    angle_matters_db += std::abs(10 * std::log10(at_random / expected)) / 10;
    const auto room = rooms::box(box.size.x, box.size.y, box.size.z, walls);
    const glm::vec3 from = point(box.from.x, box.from.y, box.from.z), to = point(box.to.x, box.to.y, box.to.z);
    const AcousticScene by_rays(room, config);
    EXPECT_NEAR(10 * std::log10(energy_of(response_of(by_rays, from, to), 0) / expected), 0, 0.4) << number;
    config.source_rays = 2048;
    const AcousticScene from_both(room, config);
    EXPECT_NEAR(10 * std::log10(energy_of(response_of(from_both, from, to), 0) / expected), 0, 0.4) << number;
  }
  EXPECT_GT(angle_matters_db, 0.5);
}

// Rows of seats as wells (docs/howto/own_materials.md): direct sound and image over the plane of the seats, at the centre of the octave of
// 125 Hz, against the closed form, 0.05 dB.  The loss is 5 dB and more.
TEST(LocallyReacting, GrazingSoundOverSeatsHasTheSeatDip) {
  for (std::uint32_t number = 0; number < 10; ++number) {
    Draws draw(kSeed, 600 + number);
    const double source_m = draw.within(0.6, 1.2), listener_m = draw.within(0.2, 0.5), apart_m = draw.within(12, 30);
    const Complex wells(0.3, 0.39);
    TriangleMesh mesh;
    rooms::append_quad(mesh, {point(-200, -200, 0), point(200, -200, 0), point(200, 200, 0), point(-200, 200, 0)}, 0);
    const AcousticScene scene(rooms::scene_of(std::move(mesh), {impedance_wall(wells)}), without_other_effects());
    const double k = 2 * std::numbers::pi * scene.bands().centre_hz[0] / rooms::kSpeedMPerS;
    Complex sum = 0;
    for (const Arrival& arrival : response_of(scene, point(0, 0, source_m), point(apart_m, 0, listener_m)).arrivals)
      sum += std::polar(double{arrival.amplitude[0]}, double{arrival.phase_rad[0]} - k * double{arrival.distance_m});
    const double direct_m = std::hypot(apart_m, source_m - listener_m), image_m = std::hypot(apart_m, source_m + listener_m);
    const double cosine = (source_m + listener_m) / image_m;
    const Complex closed_form =
        1.0 + (wells * cosine - 1.0) / (wells * cosine + 1.0) * std::polar(direct_m / image_m, -k * (image_m - direct_m));
    const double found_db = 20 * std::log10(std::abs(sum) * 4 * std::numbers::pi * direct_m);
    EXPECT_NEAR(found_db, 20 * std::log10(std::abs(closed_form)), 0.05) << number;
    EXPECT_LT(found_db, -5);
    EXPECT_GT(found_db, -40);
  }
}

// Photons meet the same walls: a field agrees with the tracer, 0.5 dB with cells of 0.5 m (docs/explanation/acoustics.md: 0.5 dB at single
// places).
TEST(LocallyReacting, FieldsAgreeWithRays) {
  for (std::uint32_t number = 0; number < 10; ++number) {
    const MirrorBox box(50 + number);
    std::array<Material, 6> walls;
    for (std::size_t i = 0; i < 6; ++i) walls[i] = impedance_wall(box.impedance[i], 0.4);
    AcousticConfig config = without_other_effects();
    config.bands = 1;
    config.rir_length_s = 0.2f;
    config.rays = 8192;
    config.diffuse_last_segment = false;
    config.field = Switch::off;
    const auto room = rooms::box(box.size.x, box.size.y, box.size.z, walls);
    const glm::vec3 from = point(box.from.x, box.from.y, box.from.z), to = point(box.to.x, box.to.y, box.to.z);
    const AcousticScene by_rays(room, config);
    config.field = Switch::on;
    config.field_photons = 1 << 15;
    config.field_error = 0.02f;
    config.field_cell_m = 0.5f;
    const AcousticScene scene(room, config);
    const EarlyCandidates candidates(scene, from);
    const auto field = build_source_field(scene, candidates);
    EXPECT_NEAR(10 * std::log10(energy_of(response_of(scene, from, to, field.get()), 0) / energy_of(response_of(by_rays, from, to), 0)), 0,
                0.5)
        << number;
  }
}

// Swapped ends have the same arrivals with the same amplitudes.
TEST(LocallyReacting, EitherDirectionHasTheSameEnergy) {
  for (std::uint32_t number = 0; number < 10; ++number) {
    const MirrorBox box(80 + number);
    std::array<Material, 6> walls;
    for (std::size_t i = 0; i < 6; ++i) walls[i] = impedance_wall(box.impedance[i], 0.2);
    const AcousticScene scene(rooms::box(box.size.x, box.size.y, box.size.z, walls), without_other_effects());
    const glm::vec3 from = point(box.from.x, box.from.y, box.from.z), to = point(box.to.x, box.to.y, box.to.z);
    const EnergyResponse there = response_of(scene, from, to), back = response_of(scene, to, from);
    ASSERT_EQ(there.arrivals.size(), back.arrivals.size());
    for (std::size_t i = 0; i < there.arrivals.size(); ++i)
      EXPECT_NEAR(there.arrivals[i].amplitude[1], back.arrivals[i].amplitude[1], 1e-5f * there.arrivals[i].amplitude[1]);
  }
}

}  // namespace
}  // namespace earshot
