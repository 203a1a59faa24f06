// SPDX-License-Identifier: Apache-2.0
// Levels of what leaves a source that does not radiate alike everywhere, against its pattern by hand.

#include <gtest/gtest.h>

#include <cmath>
#include <functional>
#include <glm/glm.hpp>
#include <glm/gtc/quaternion.hpp>
#include <numbers>

#include "sim/acoustics/response/energy_response.h"
#include "tests/support/acoustics/rooms.h"

namespace earshot {
namespace {

using rooms::point;

SoundSource cardioid(glm::vec3 at, glm::vec3 ahead) {
  SoundSource source(at);
  source.directivity = Directivity::first_order(0.5f);
  source.orientation = glm::quat(glm::vec3(0, 0, -1), ahead);
  return source;
}

EnergyResponse response_of(const AcousticScene& scene, const SoundSource& source, glm::vec3 listener) {
  EnergyResponse response;
  compute_energy_response(scene, EarlyCandidates(scene, source), listener, response);
  return response;
}

// (1 + cos) / 2 of the angle between where the source looks and where the sound goes, times 1 / (4 pi r).
TEST(DirectionalSource, DirectSoundHasTheGainTowardTheListener) {
  const AcousticScene scene(rooms::empty(), rooms::plain_config());
  const glm::vec3 at(1, 2, 3);
  for (const glm::vec3 ahead : {glm::vec3(0, 0, -1), glm::vec3(1, 0, 0), glm::normalize(glm::vec3(1, 2, -2))})
    for (const glm::vec3 toward : {glm::vec3(0, 0, -1), glm::vec3(0, 0, 1), glm::vec3(1, 0, 0), glm::vec3(0, 1, 0)}) {
      const EnergyResponse response = response_of(scene, cardioid(at, ahead), at + 2.f * toward);
      const double gain = 0.5 + 0.5 * static_cast<double>(glm::dot(ahead, toward));
      const double heard = response.arrivals.empty() ? 0.0 : double{response.arrivals[0].amplitude[0]};
      EXPECT_NEAR(heard, gain / (4 * std::numbers::pi * 2), 1e-6)
          << ahead.x << " toward " << toward.x << " " << toward.y << " " << toward.z;
      for (const Arrival& arrival : response.arrivals) EXPECT_GT(glm::dot(arrival.departure, toward), 0.9999f);
    }
}

/// Integral of gain^2 cos cos / (d1^2 d2^2) over the floor y = 0: what one diffuse reflection brings, but for a factor.
double one_bounce(glm::dvec3 source, glm::dvec3 listener, const std::function<double(double)>& gain_of_cosine_down) {
  double sum = 0;
  constexpr double kRings = 600, kTurns = 360;
  for (int i = 0; i < kRings; ++i) {
    // Rings about the point under the source, out to 100 m, finer near it.
    const double inner = 100 * std::pow(i / kRings, 3), outer = 100 * std::pow((i + 1) / kRings, 3), radius = 0.5 * (inner + outer);
    for (int k = 0; k < kTurns; ++k) {
      const double angle = 2 * std::numbers::pi * (k + 0.5) / kTurns;
      const glm::dvec3 at(source.x + radius * std::cos(angle), 0, source.z + radius * std::sin(angle));
      const double there_m = glm::distance(source, at), back_m = glm::distance(at, listener);
      const double gain = gain_of_cosine_down(source.y / there_m);
      sum += gain * gain * source.y / there_m * listener.y / back_m / (there_m * there_m * back_m * back_m) *
             (outer * outer - inner * inner) * std::numbers::pi / kTurns;
    }
  }
  return sum;
}

// A source that looks at the ground is louder in it than one that looks up.  65,536 rays: the standard error is below 1 %.
TEST(DirectionalSource, LateSoundHasTheGainTowardTheWall) {
  AcousticConfig config = rooms::plain_config();
  config.rays = 1 << 16;
  config.rir_length_s = 0.3f;
  const AcousticScene scene(rooms::half_space(0.2, 1), config);
  const glm::vec3 at = point(0, 0, 1.5), listener = point(1, 0, 1.2);
  const double omni = rooms::total_energy(response_of(scene, SoundSource(at), listener).late);
  const double whole = one_bounce(at, listener, [](double) { return 1.0; });
  ASSERT_GT(omni, 0);
  for (const double sign : {1.0, -1.0}) {
    const EnergyResponse heard = response_of(scene, cardioid(at, {0, static_cast<float>(-sign), 0}), listener);
    const double expected = one_bounce(at, listener, [&](double cosine_down) { return 0.5 + 0.5 * sign * cosine_down; }) / whole;
    EXPECT_NEAR(rooms::total_energy(heard.late) / omni, expected, 0.03 * expected) << (sign > 0 ? "down" : "up");
  }
}

// Over one mirror the sound comes from the image, whose distance says when, to a bin of half a millisecond.
TEST(DirectionalSource, SoundOfASourceWithAVolumeIsLateByItsWholeWay) {
  AcousticConfig config = rooms::plain_config();
  config.rays = 1 << 18;
  config.rir_length_s = 0.1f;
  config.time_bin_s = 0.0005f;
  const AcousticScene scene(rooms::half_space(0.2, 0), config);
  SoundSource source(point(0, 0, 1.5));
  source.radius_m = 0.1f;
  const glm::vec3 listener = point(2, 0, 1.2);
  const EnergyResponse response = response_of(scene, source, listener);
  double energy = 0, moment = 0;
  for (int bin = 0; bin < response.late.num_bins(); ++bin) {
    energy += double{response.late.energy(bin, 0)};
    moment += double{response.late.energy(bin, 0)} * (bin + 0.5) * double{response.late.bin_s()};
  }
  ASSERT_GT(energy, 0);
  const double image_m = std::hypot(2.0, 2.7);
  EXPECT_NEAR(moment / energy, image_m / scene.speed_of_sound_m_per_s(), 0.0005);
  // Of 1 / (4 pi r)^2 times 0.8 about 40 rays in 10,000 meet it: a fifth of scatter leaves a factor of 2 out of the question.
  EXPECT_NEAR(energy / (0.8 / std::pow(4 * std::numbers::pi * image_m, 2)), 1, 0.4);
}

}  // namespace
}  // namespace earshot
