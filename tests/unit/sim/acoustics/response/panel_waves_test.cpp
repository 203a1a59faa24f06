// SPDX-License-Identifier: Apache-2.0
// Which panels in the air send waves to their sides, and what stands for those of the others.

#include <gtest/gtest.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <complex>
#include <numbers>

#include "sim/acoustics/paths/panel_reflection.h"
#include "sim/acoustics/response/energy_response.h"
#include "sim/scene/materials/wall_impedance.h"
#include "tests/support/acoustics/rooms.h"
#include "tests/support/draws.h"

namespace earshot::panel_waves {
namespace {

constexpr std::uint64_t kSeed = 52;  // of what is drawn

constexpr double kPi = std::numbers::pi, kSpeed = 343;
constexpr std::uint32_t kDraws = 12;
const Material kRigid = Material::uniform("rigid", 0.f, 0.f);

AcousticConfig config_with(Switch diffraction) {
  AcousticConfig config;
  config.rays = 64;
  config.diffraction = diffraction;
  config.air_absorption = config.late = Switch::off;
  config.rir_length_s = 1;
  return config;
}

/// A panel in the plane y = 0, and a listener whose point of reflection lies beyond its end at x = half_x.
struct Place {
  double half_x, half_z;
  glm::dvec3 source, listener;
  TriangleMesh mesh;

  /// higher: factor of the heights of source and listener.
  Place(Draws& draw, double least_beyond_m, double most_beyond_m, double half_z_m = 0, double higher = 1) {
    half_x = draw.within(0.6, 1.2), half_z = half_z_m > 0 ? half_z_m : draw.within(0.3, 0.8);
    source = {draw.within(-1, 0.3), higher * draw.within(1.5, 2.5), draw.within(-0.2, 0.2)};
    const double height_m = source.y * draw.within(0.9, 1.2), at = half_x + draw.within(least_beyond_m, most_beyond_m);
    listener = {source.x + (at - source.x) * (source.y + height_m) / source.y, height_m, draw.within(-0.2, 0.2)};
    const auto corner = [&](double x, double z) { return glm::vec3(x * half_x, 0, z * half_z); };
    rooms::append_quad(mesh, {corner(-1, -1), corner(-1, 1), corner(1, 1), corner(1, -1)}, 0);
  }
  [[nodiscard]] AcousticScene scene(const AcousticConfig& config, const Material& material = kRigid) const {
    return {rooms::scene_of(mesh, {material}), config};
  }
  [[nodiscard]] EnergyResponse respond(const AcousticScene& scene, double radius_m = 0) const {
    SoundSource sound{glm::vec3(source)};
    sound.radius_m = static_cast<float>(radius_m);
    EnergyResponse response;
    compute_energy_response(scene, EarlyCandidates(scene, sound), glm::vec3(listener), response);
    return response;
  }
  [[nodiscard]] const PanelShape& shape(const AcousticScene& scene) const {
    return *std::ranges::find_if(scene.panel_shapes()->all(),
                                 [&](const PanelShape& panel) { return panel.normal.y > 0.9 && std::abs(panel.centre.y) < 1e-6; });
  }
  /// Pressure of the wave of a rigid panel, by PanelWave; phase beyond that of the path by the image.
  [[nodiscard]] std::complex<double> wave(const AcousticScene& scene, std::size_t band) const {
    const PanelWave wave(shape(scene), glm::dvec3(glm::vec3(source)), glm::dvec3(glm::vec3(listener)));
    std::array<double, kLanes> wavenumber;
    wavenumber.fill(2 * kPi * scene.bands().centre_hz[band] / kSpeed);
    const PanelReflection::Factor factor = wave.factor(WaveLanes(wavenumber));
    return std::polar(std::sqrt(double{factor.energy[0]}) / (4 * kPi * wave.image_m()), double{factor.phase_rad[0]});
  }
  /// Has it the size of the wave in all bands?
  [[nodiscard]] bool is_wave(const AcousticScene& scene, const Arrival& arrival) const {
    if (arrival.kind != ArrivalKind::diffraction) return false;
    for (std::size_t band = 0; band < static_cast<std::size_t>(scene.num_bands()); ++band)
      if (!(std::abs(double{arrival.amplitude[band]} / std::abs(wave(scene, band)) - 1) < 1e-3)) return false;
    return true;
  }
  [[nodiscard]] int count(const AcousticScene& scene, std::span<const Arrival> arrivals) const {
    return static_cast<int>(std::ranges::count_if(arrivals, [&](const Arrival& arrival) { return is_wave(scene, arrival); }));
  }
};

/// Energy from below, beside that of images.
double from_below(const EnergyResponse& response, std::size_t band) {
  double sum = 0;
  for (const Arrival& arrival : response.arrivals)
    if (arrival.kind == ArrivalKind::diffraction && arrival.direction.y < -0.1f)
      sum += double{arrival.amplitude[band]} * double{arrival.amplitude[band]};
  return sum;
}

double level_db(double energy) { return 10 * std::log10(std::max(energy, 1e-30)); }

// Its centre's, once: the size of the wave does not depend on the radius.
TEST(PanelWaves, ASourceWithARadiusHasThem) {
  for (const Switch diffraction : {Switch::automatic, Switch::on}) {
    for (std::uint32_t number = 0; number < kDraws; ++number) {
      Draws draw(kSeed, number);
      const Place place(draw, 0.1, 0.5);
      const AcousticScene scene = place.scene(config_with(diffraction));
      for (const double radius_m : {0.0, 0.02, 0.1, 0.3}) {
        const EnergyResponse response = place.respond(scene, radius_m);
        EXPECT_EQ(place.count(scene, response.arrivals), 1) << number << " radius " << radius_m;
        EXPECT_TRUE(std::ranges::is_sorted(response.arrivals, {}, &Arrival::distance_m));
      }
    }
  }
}

// Over a rigid panel's: the reflection of plane waves at the angle of the image, with its phase.  Single precision: 1e-4.
TEST(PanelWaves, OfALocallyReactingPanelHaveItsReflectionAtTheAngle) {
  for (std::uint32_t number = 20; number < 20 + kDraws; ++number) {
    Draws draw(kSeed, number);
    const Place place(draw, 0.02, 0.3);
    const std::complex<double> impedance = std::polar(std::pow(10.0, draw.within(0.2, 1.0)), draw.within(-1.2, 1.2));
    const double scattering = draw.within(0, 0.4);
    Material wall = Material::uniform("wall", static_cast<float>(random_incidence_absorption(impedance)), static_cast<float>(scattering));
    wall.locally_reacting = true;
    wall.impedance_real = CoefficientCurve::constant(static_cast<float>(impedance.real()));
    wall.impedance_imaginary = CoefficientCurve::constant(static_cast<float>(impedance.imag()));
    const AcousticScene rigid = place.scene(config_with(Switch::automatic)), reacting = place.scene(config_with(Switch::automatic), wall);
    const EnergyResponse of_rigid = place.respond(rigid), of_reacting = place.respond(reacting);
    const auto wave = std::ranges::find_if(of_rigid.arrivals, [&](const Arrival& arrival) { return place.is_wave(rigid, arrival); });
    ASSERT_NE(wave, of_rigid.arrivals.end()) << number;
    const auto found = std::ranges::find(of_reacting.arrivals, wave->identity, &Arrival::identity);
    ASSERT_NE(found, of_reacting.arrivals.end()) << number;
    const double rise_m = place.source.y + place.listener.y;
    const double cosine = rise_m / std::hypot(place.listener.x - place.source.x, rise_m, place.listener.z - place.source.z);
    const std::complex<double> expected = (impedance * cosine - 1.0) / (impedance * cosine + 1.0) * std::sqrt(1 - scattering);
    for (std::size_t band = 0; band < static_cast<std::size_t>(rigid.num_bands()); ++band) {
      const std::complex<double> ratio = std::polar(double{found->amplitude[band]} / double{wave->amplitude[band]},
                                                    double{found->phase_rad[band]} - wave->phase_rad[band]);
      EXPECT_LT(std::abs(ratio - expected), 1e-4 + 1e-4 * std::abs(expected)) << number << " band " << band;
    }
  }
}

/// Half the length of a panel whose ends are more than a wave of detour away at 1 kHz, and play no part.
constexpr double kLongM = 2;

// The tracers reflect the whole of a panel there.  Edges reflect on past the panel's end: on the boundary both they and a wave have half
// the pressure of the image, and beside it they differ by less than the 3 dB of a factor of 2.
TEST(PanelWaves, NoneWithoutImages) {
  for (std::uint32_t number = 40; number < 40 + kDraws; ++number) {
    Draws draw(kSeed, number);
    const Place place(draw, 0.02, 0.06, kLongM);
    for (const bool lobes : {false, true}) {
      AcousticConfig config = config_with(Switch::on);
      const AcousticScene with_images = place.scene(config);
      ASSERT_EQ(place.count(with_images, place.respond(with_images).arrivals), 1) << number;
      if (lobes) {
        config.specular_exponent = 50;
      } else {
        config.early = Switch::off;
      }
      const AcousticScene scene = place.scene(config);
      const EnergyResponse response = place.respond(scene);
      EXPECT_EQ(place.count(scene, response.arrivals), 0) << number;
      EXPECT_NEAR(level_db(from_below(response, 3)), level_db(std::norm(place.wave(scene, 3))), 2.5) << number;
    }
  }
}

// At most 1 % of the direct pressure in any band: late energy, of the same size.
TEST(PanelWaves, WeakOnesAreLateEnergy) {
  int weak = 0;
  for (std::uint32_t number = 60; number < 100; ++number) {
    Draws draw(kSeed, number);
    const Place place(draw, 0.1, 3, 0, draw.within(1, 40));
    const AcousticScene scene = place.scene(config_with(Switch::automatic));
    const EnergyResponse response = place.respond(scene);
    double most = 0;
    for (std::size_t band = 0; band < static_cast<std::size_t>(scene.num_bands()); ++band)
      most = std::max(most, std::abs(place.wave(scene, band)));
    const bool is_weak = most < 0.01 / (4 * kPi * glm::length(place.source - place.listener));
    weak += is_weak ? 1 : 0;
    EXPECT_EQ(place.count(scene, response.arrivals), is_weak ? 0 : 1) << number;
    EXPECT_EQ(place.count(scene, response.scattered), is_weak ? 1 : 0) << number;
  }
  EXPECT_GT(weak, 5);
}

/// Sixteen panels above that the source sees larger.
void append_larger(Place& place) {
  const double lowest_m = std::max(place.source.y, place.listener.y) + 1;
  for (int i = 0; i < 16; ++i) {
    const auto corner = [&](double x, double z) { return glm::vec3(x, lowest_m + 0.05 * i, z); };
    rooms::append_quad(place.mesh, {corner(-4, -4), corner(4, -4), corner(4, 4), corner(-4, 4)}, 0);
  }
}

// Panels past the number that have waves keep what they had before: with few rays what they reflect but not here is late energy, with many
// their edges reflect.
TEST(PanelWaves, SmallerPanelsKeepWhatTheyReflect) {
  int scattering = 0;
  for (std::uint32_t number = 120; number < 120 + kDraws; ++number) {
    Draws draw(kSeed, number);
    Place beside(draw, 0.02, 0.06, kLongM);
    append_larger(beside);
    const AcousticScene many = beside.scene(config_with(Switch::on));
    ASSERT_GE(many.panel_shapes()->all().size(), 34u);
    const EnergyResponse edges = beside.respond(many);
    EXPECT_EQ(beside.count(many, edges.arrivals), 0) << number;
    EXPECT_NEAR(level_db(from_below(edges, 3)), level_db(std::norm(beside.wave(many, 3))), 2.5) << number;

    Place place(draw, -0.5, -0.1);
    append_larger(place);
    const AcousticScene few = place.scene(config_with(Switch::automatic));
    const EnergyResponse response = place.respond(few);
    const auto image = std::ranges::find_if(response.arrivals, [](const Arrival& arrival) {
      return arrival.kind == ArrivalKind::reflection && arrival.order == 1 && arrival.direction.y < 0;
    });
    ASSERT_NE(image, response.arrivals.end()) << number;
    const double distance_m = double{image->distance_m}, cosine = (place.source.y + place.listener.y) / distance_m;
    for (std::size_t band = 0; band < 6; ++band) {
      const double whole = 1 / std::pow(4 * kPi * distance_m, 2), here = double{image->amplitude[band]} * double{image->amplitude[band]};
      double late = 0;
      for (const Arrival& arrival : response.scattered)
        if (arrival.identity == image->identity) late += double{arrival.amplitude[band]} * double{arrival.amplitude[band]};
      const double reflected = reflected_fraction(place.shape(few), 2 * kPi * few.bands().centre_hz[band] / kSpeed, cosine) * whole;
      EXPECT_NEAR(here + late, std::max(reflected, here), 1e-4 * whole) << number << " band " << band;
      scattering += late > 0 ? 1 : 0;
    }
  }
  EXPECT_GT(scattering, 20);
}

// A scene of so many planes that rays find the images, and rays that find none: a panel that has a wave has its image too, and the tracers
// reflect nothing of it.  All else absorbs.
TEST(PanelWaves, PanelsThatCandidateRaysMissAreCountedOnce) {
  for (std::uint32_t number = 160; number < 160 + kDraws; ++number) {
    Draws draw(kSeed, number);
    Place place(draw, -0.5, -0.1);  // the image is in sight
    for (int i = 0; i < 2100; ++i) {
      const double angle = 0.7 * i, slope = 1e-3 * i;
      const glm::vec3 at(60 * std::cos(angle), 20 + 0.02 * i, 60 * std::sin(angle)), x(0.01, 0.01 * slope, 0), z(0.003 * slope, 0, 0.01);
      rooms::append_quad(place.mesh, {at, at + x, at + x + z, at + z}, 1);
    }
    AcousticConfig config = config_with(Switch::automatic);
    config.late = Switch::on;
    config.rays = 256;
    config.early_candidate_rays = 1;
    const AcousticScene scene(rooms::scene_of(place.mesh, {kRigid, Material::uniform("black", 1.f, 0.f)}), config);
    ASSERT_GT(scene.planes().size(), 2048u);
    const EarlyCandidates candidates(scene, glm::vec3(place.source));
    const std::array<std::uint32_t, 1> planes = {place.shape(scene).plane};
    EXPECT_TRUE(candidates.contains(planes)) << number;
    const EnergyResponse response = place.respond(scene);
    EXPECT_EQ(std::ranges::count_if(response.arrivals, [](const Arrival& arrival) { return arrival.kind == ArrivalKind::reflection; }), 1);
    double late = 0;
    for (int bin = 0; bin < response.late.num_bins(); ++bin) late += double{response.late.energy(bin, 3)};
    EXPECT_EQ(late, 0) << number;
  }
}

}  // namespace
}  // namespace earshot::panel_waves
