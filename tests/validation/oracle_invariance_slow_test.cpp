// SPDX-License-Identifier: Apache-2.0
#include <gtest/gtest.h>

#include <glm/geometric.hpp>
#include <glm/gtc/quaternion.hpp>

#include "sim/acoustics/response/energy_response.h"
#include "tests/support/acoustics/decay.h"
#include "tests/support/acoustics/late_field.h"

// docs/evidence/oracles.md, O-20: what a rigid motion of scene, source and listener must not change.
namespace earshot {
namespace {

struct Motion {
  glm::quat turn{1, 0, 0, 0};
  glm::vec3 shift{0};
  [[nodiscard]] glm::vec3 at(glm::vec3 p) const { return turn * p + shift; }
};

const Motion kTurned{glm::angleAxis(2.1f, glm::normalize(glm::vec3(0.3f, -0.8f, 0.5f))), glm::vec3(0)};

std::shared_ptr<const Scene> moved_shoe1(const Motion& motion, double absorption, double scattering) {
  const auto still = rooms::shoe1(absorption, scattering);
  TriangleMesh mesh = still->mesh();
  for (glm::vec3& vertex : mesh.vertices) vertex = motion.at(vertex);
  return std::make_shared<Scene>("moved", std::move(mesh), still->materials(), still->air());
}

std::vector<Arrival> arrivals(const Motion& motion) {
  AcousticConfig config = rooms::plain_config();
  config.early = Switch::automatic;
  config.early_order = 3;
  const AcousticScene scene(moved_shoe1(motion, 0.2, 0.1), config);
  std::vector<Arrival> found;
  EarlyCandidates(scene, motion.at(rooms::shoe1_source())).find_arrivals(scene, motion.at(rooms::shoe1_listener()), found);
  return found;
}

TEST(OracleO20, ATurnedSceneHasTheSameImagePaths) {
  const std::vector<Arrival> still = arrivals({}), turned = arrivals(kTurned);
  ASSERT_EQ(still.size(), 63u);  // 1 + 6 + 18 + 38 images of a box up to third order
  ASSERT_EQ(turned.size(), still.size());
  for (std::size_t i = 0; i < still.size(); ++i) {
    // Two pairs of images arrive together and may change places; distance and amplitude are the same then.
    EXPECT_NEAR(turned[i].distance_m, still[i].distance_m, 2e-6f * still[i].distance_m) << i;
    EXPECT_NEAR(turned[i].amplitude[0], still[i].amplitude[0], 2e-6f * still[i].amplitude[0]) << i;
    float nearest = 2;
    for (const Arrival& other : turned) {
      if (std::fabs(other.distance_m - still[i].distance_m) > 1e-4f) continue;
      nearest = std::min(nearest, glm::length(other.direction - kTurned.turn * still[i].direction) +
                                      glm::length(other.departure - kTurned.turn * still[i].departure));
    }
    EXPECT_LT(nearest, 1e-5f) << i;
  }
}

TEST(OracleO20, AShiftOfAKilometreKeepsArrivalTimes) {
  // At 1 km a float coordinate has steps of 0.06 mm: 0.2 us, and as much per reflection.
  const std::vector<Arrival> still = arrivals({}), shifted = arrivals({.shift = {1000, -30, 1000}});
  ASSERT_EQ(shifted.size(), still.size());
  for (std::size_t i = 0; i < still.size(); ++i) {
    EXPECT_NEAR(shifted[i].distance_m, still[i].distance_m, 1e-3f) << i;
    EXPECT_NEAR(shifted[i].amplitude[0], still[i].amplitude[0], 1e-3f * still[i].amplitude[0]) << i;
  }
}

/// Late energy in 20 ms windows, and its mean direction, over seeds.
struct Late {
  std::vector<decay::Estimate> window;
  std::array<decay::Estimate, 3> direction;
};
Late late(const Motion& motion) {
  AcousticConfig config = rooms::plain_config();
  config.rays = 4096;
  config.rir_length_s = 0.24f;
  config.sh_order = 1;
  constexpr int windows = 12, seeds = 16;
  std::vector<std::vector<double>> energy(windows);
  std::array<std::vector<double>, 3> direction;
  const auto room = moved_shoe1(motion, 0.2, 0.8);
  for (int seed = 1; seed <= seeds; ++seed) {
    config.seed = static_cast<std::uint64_t>(seed);
    const EnergyHistogram h = rooms::late_field(room, config, motion.at(rooms::shoe1_source()), motion.at(rooms::shoe1_listener()));
    glm::dvec3 moment(0);
    for (int w = 0; w < windows; ++w) {
      double sum = 0;
      for (int i = 5 * w; i < 5 * w + 5; ++i) {
        sum += h.energy(i, 0);
        // ACN 1, 2, 3 of ambisonic axes (x, y, z) = (-z, -x, y) of the world.
        const std::span<const float> c = h.at(i, 0);
        moment += glm::dvec3(-c[1], c[2], -c[3]);
      }
      energy[w].push_back(sum);
    }
    for (int axis = 0; axis < 3; ++axis) direction[axis].push_back(moment[axis]);
  }
  Late result;
  for (const auto& values : energy) result.window.push_back(decay::estimate(values));
  for (int axis = 0; axis < 3; ++axis) result.direction[axis] = decay::estimate(direction[axis]);
  return result;
}

TEST(OracleO20, ATurnedOrShiftedSceneHasTheSameLateField) {
  const Late still = late({});
  for (const Motion& motion : {kTurned, Motion{.shift = {1000, -30, 1000}}}) {
    const Late moved = late(motion);
    for (std::size_t w = 0; w < still.window.size(); ++w) {
      const double sigma = std::hypot(still.window[w].standard_error, moved.window[w].standard_error);
      EXPECT_NEAR(moved.window[w].mean, still.window[w].mean, 4 * sigma) << 20 * w << " ms";
      EXPECT_LT(sigma, 0.06 * still.window[w].mean) << 20 * w << " ms";
    }
    const auto vector = [](const Late& l) { return glm::vec3(l.direction[0].mean, l.direction[1].mean, l.direction[2].mean); };
    double sigma2 = 0;
    for (int axis = 0; axis < 3; ++axis) {
      sigma2 += std::pow(still.direction[axis].standard_error, 2) + std::pow(moved.direction[axis].standard_error, 2);
    }
    const glm::vec3 expected = motion.turn * vector(still);
    EXPECT_LT(glm::length(vector(moved) - expected), 4 * std::sqrt(sigma2));
    EXPECT_GT(glm::length(expected), 8 * std::sqrt(sigma2)) << "a field without direction would pass";
  }
}

}  // namespace
}  // namespace earshot
