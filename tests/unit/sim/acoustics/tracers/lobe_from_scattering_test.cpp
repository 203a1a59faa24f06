// SPDX-License-Identifier: Apache-2.0
// specular_exponent: from_scattering.  One lobe for all reflections, its exponent from the scattering coefficient of material and band.

#include <gtest/gtest.h>

#include <array>
#include <cmath>
#include <numbers>
#include <vector>

#include "sim/acoustics/model/lobe_shares.h"
#include "sim/acoustics/response/energy_response.h"
#include "sim/acoustics/tracers/scatter.h"
#include "sim/base/random.h"
#include "tests/support/acoustics/bidirectional_field.h"

namespace earshot {
namespace {

constexpr int kBands = 8;

/// Scattering drawn at random in each band: bands of half of the materials over [0, 1], of the others over decades.
Material drawn_material(std::uint32_t number, float absorption) {
  const RandomStream random(382, Purpose::test, number);
  Material material = Material::uniform("drawn", absorption, 0.f);
  std::vector<float> hz, s;
  for (std::uint32_t i = 0; i < kBands; ++i) {
    hz.push_back(62.5f * std::exp2(static_cast<float>(i)));
    const float u = random.uniform(i);
    s.push_back(number % 2 == 0 ? u : std::pow(10.f, -4.f * u));
  }
  material.scattering = {hz, s};
  return material;
}

std::shared_ptr<const Scene> room_of(const Material& material) {
  std::array<Material, 6> walls;
  walls.fill(material);
  return rooms::box(5, 4, 3, walls);
}

constexpr std::uint32_t kMaterials = 12;

/// Floors side by side, ten metres apart, one of each material: their lobes are made once.
std::shared_ptr<const Scene> floors() {
  TriangleMesh mesh;
  std::vector<Material> materials;
  for (std::uint32_t number = 0; number < kMaterials; ++number) {
    const double x = 10.0 * number;
    rooms::append_quad(mesh, {rooms::point(x, 0, 0), rooms::point(x + 1, 0, 0), rooms::point(x + 1, 1, 0), rooms::point(x, 1, 0)}, number);
    materials.push_back(drawn_material(number, 0.f));
  }
  return rooms::scene_of(std::move(mesh), std::move(materials));
}

AcousticConfig lobes_config() {
  AcousticConfig config = rooms::bidirectional_config(64);
  config.bands = 0;
  config.specular_exponent = kExponentFromScattering;
  return config;
}

TEST(LobeShares, SumToOneAndKeepTheMeanCosine) {
  for (std::uint32_t i = 0; i <= 2000; ++i) {
    const float u = static_cast<float>(i) / 2000, s = i % 2 == 0 ? u : std::pow(10.f, -5 * u);
    const LobeShares shares = shares_of_scattering(s);
    double sum = double{shares.diffuse} + double{shares.mirror}, cosine = double{shares.mirror} + 2.0 / 3.0 * double{shares.diffuse};
    int parts = (shares.diffuse > 0) + (shares.mirror > 0);
    for (std::size_t k = 0; k < kLobeLadder; ++k) {
      ASSERT_GE(shares.lobe[k], 0.f);
      sum += double{shares.lobe[k]};
      // Integral of (n + 2) / (2 pi) cos^n cos cos over the hemisphere.
      cosine += double{shares.lobe[k]} * (double{kLadderExponents[k]} + 2) / (double{kLadderExponents[k]} + 3);
      parts += shares.lobe[k] > 0;
    }
    EXPECT_NEAR(sum, 1, 1e-6) << s;
    EXPECT_NEAR(cosine, 1 - double{s} / 3, 1e-6) << s;
    EXPECT_LE(parts, 2);
  }
  EXPECT_EQ(shares_of_scattering(1).diffuse, 1.f);
  EXPECT_EQ(shares_of_scattering(0).mirror, 1.f);
  EXPECT_EQ(shares_of_scattering(0.75f).lobe[0], 1.f);
}

// What the sampler brings, over its own draws: all energy at every angle, and at normal incidence the mean cosine 1 - s / 3 to the mirror
// direction.  Each within four standard errors, in each band of twelve materials; a factor of 2 in any part is a hundred.
TEST(LobeFromScattering, WhiteFurnaceOfTheSampler) {
  const AcousticScene scene(floors(), lobes_config());
  ASSERT_EQ(scene.padded_bands(), 8);
  for (std::uint32_t number = 0; number < kMaterials; ++number) {
    for (const double degrees : {0.0, 15.0 + 5.0 * number, 85.0}) {
      const double radians = degrees * std::numbers::pi / 180;
      const glm::vec3 incident(static_cast<float>(std::sin(radians)), -static_cast<float>(std::cos(radians)), 0.f);
      const Hit hit = scene.scene().rays().intersect(rooms::point(10.0 * number + 0.5, 0.5, 0) - 0.1f * incident, incident);
      ASSERT_TRUE(hit.valid());
      ASSERT_GT(hit.normal.y, 0.99f);
      const glm::vec3 mirror = mirror_direction(incident, hit.normal);
      std::array<double, kBands> energy{}, squares{}, cosine{}, cosine_squares{};
      constexpr std::uint32_t draws = 40000;
      for (std::uint32_t draw = 0; draw < draws; ++draw) {
        SubpathEnergy<8> ray;
        for (int b = 0; b < 8; ++b) ray.arriving[b] = ray.weight[b] = b < scene.num_bands() ? 1.f : 0.f;
        meet_surface<8>(scene.reflection_model(), number, ray);
        glm::vec3 origin, direction = incident;
        const Departure departure =
            leave_surface<8>(scene, hit, RandomStream(5, Purpose::test, number, draw).uniform4(0), ray, origin, direction);
        ASSERT_NE(departure.way, Leaving::through);
        ASSERT_GE(direction.y, -1e-6f);
        const double c = double{glm::dot(direction, mirror)};
        for (std::size_t b = 0; b < static_cast<std::size_t>(scene.num_bands()); ++b) {
          const double e = double{ray.arriving[b]};
          energy[b] += e / draws, squares[b] += e * e / draws;
          cosine[b] += e * c / draws, cosine_squares[b] += e * e * c * c / draws;
        }
      }
      for (std::size_t b = 0; b < static_cast<std::size_t>(scene.num_bands()); ++b) {
        const double s = double{scene.scattering(number)[b]};
        const double error = std::sqrt(std::max(squares[b] - energy[b] * energy[b], 0.0) / draws) + 1e-4;  // O-30: the table's 1e-4
        EXPECT_NEAR(energy[b], 1, 4 * error) << number << ", " << degrees << " degrees, s = " << s;
        EXPECT_LT(error, 0.05);
        if (degrees > 0) continue;
        const double spread = std::sqrt(std::max(cosine_squares[b] - cosine[b] * cosine[b], 0.0) / draws) + 1e-4;
        EXPECT_NEAR(cosine[b], 1 - s / 3, 4 * spread) << number << ", s = " << s;
      }
    }
  }
}

TEST(LobeFromScattering, IsReciprocal) {
  const AcousticScene scene(floors(), lobes_config());
  for (std::uint32_t number = 0; number < kMaterials; ++number) {
    const RandomStream random(6, Purpose::test, number);
    for (std::uint32_t pair = 0; pair < 200; ++pair) {
      const auto u = random.uniform4(pair);
      const glm::vec3 up(0, 1, 0), in = lambert_direction(up, u[0], u[1]), out = lambert_direction(up, u[2], u[3]);
      float there[8], back[8];
      rough_value<8>(scene.reflection_model(), number, up, in, out, there);
      rough_value<8>(scene.reflection_model(), number, up, out, in, back);
      for (int b = 0; b < scene.num_bands(); ++b) EXPECT_NEAR(there[b], back[b], 1e-4f * (1 + there[b])) << number;
    }
  }
}

// A lossless room fills evenly: c / (4 pi V) in each of 16 bands, whatever its scattering.  Sixty bounces: one per cent lost in each would
// be a half.
TEST(LobeFromScattering, NothingIsLostInALosslessRoom) {
  AcousticConfig config = lobes_config();
  config.rays = config.source_rays = 4096;
  config.rir_length_s = 0.4f;
  config.source_radius_m = 0.6f;
  for (const std::uint32_t number : {0u, 2u}) {
    const rooms::BidirectionalField field =
        rooms::bidirectional_field(room_of(drawn_material(number, 0.f)), config, rooms::shoe1_source(), rooms::shoe1_listener());
    for (int band = 0; band < field.histogram.num_bands(); ++band)
      rooms::expect_near(field.sum(band, [](double t) { return t >= 0.2 && t < 0.4 ? 5.0 : 0.0; }), 0.454921, 4, 0.1);
  }
}

/// Bits of the late field of a room of scattering s.
std::vector<float> late_bits(float s, float exponent) {
  AcousticConfig config = rooms::bidirectional_config(128);
  config.rir_length_s = 0.2f;
  config.source_radius_m = 0.5f;
  config.specular_exponent = exponent;
  const auto field = rooms::bidirectional_field(rooms::shoe1(0.2, double{s}), config, rooms::shoe1_source(), rooms::shoe1_listener());
  const auto values = field.histogram.values();
  return {values.begin(), values.end()};
}

TEST(LobeFromScattering, EndsAreTheMirrorAndLambert) {
  EXPECT_EQ(late_bits(0, kExponentFromScattering), late_bits(0, 0));
  EXPECT_EQ(late_bits(1, kExponentFromScattering), late_bits(1, 0));
  EXPECT_NE(late_bits(0.5f, kExponentFromScattering), late_bits(0.5f, 0));
}

}  // namespace
}  // namespace earshot
