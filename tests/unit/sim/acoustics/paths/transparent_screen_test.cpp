// SPDX-License-Identifier: Apache-2.0
#include <gtest/gtest.h>

#include <cmath>
#include <complex>
#include <numbers>

#include "sim/acoustics/response/energy_response.h"
#include "tests/support/acoustics/coherent_field.h"
#include "tests/support/acoustics/rooms.h"
#include "tests/support/acoustics/uniform_theory.h"

namespace earshot {
namespace {

using Complex = std::complex<double>;

/// A half plane at z = 0, y < 0, that lets tau through and reflects the rest; or the same as a wall of 0.1 m.
std::shared_ptr<const Scene> screen(float tau, bool thick) {
  TriangleMesh mesh;
  const float reach = 300;
  if (thick)
    append_box(mesh, {-reach, -reach, -0.05f}, {reach, 0, 0.05f}, 0, 0);
  else
    rooms::append_quad(mesh, {glm::vec3(-reach, -reach, 0), glm::vec3(reach, -reach, 0), glm::vec3(reach, 0, 0), glm::vec3(-reach, 0, 0)},
                       0);
  return rooms::scene_of(std::move(mesh), {Material::uniform("screen", tau, 0.f, tau)});
}

AcousticConfig forced() { return coherent_field::config_with(Switch::on); }

/// Coherent sum of all arrivals at a band's centre.
Complex pressure(const AcousticScene& scene, const EarlyCandidates& candidates, glm::vec3 listener, std::size_t band) {
  return coherent_field::pressure(scene, coherent_field::arrivals_of(scene, candidates, listener), band);
}

/// On a circle of 3 m about the edge, from the source's side over the top to behind the screen.
glm::vec3 on_circle(double degrees) {
  const double angle = degrees * std::numbers::pi / 180;
  return {0.3f, static_cast<float>(3 * std::cos(angle)), static_cast<float>(3 * std::sin(angle))};
}

TEST(O24Babinet, ScreenThatLetsAllThroughIsNoScreen) {
  for (const bool thick : {false, true}) {
    const AcousticScene scene(screen(0.999f, thick), forced());
    const glm::vec3 source(0, -1, 2.5f);
    const EarlyCandidates candidates(scene, source);
    for (double degrees = 175; degrees > -175; degrees -= 2.5) {
      const glm::vec3 listener = on_circle(degrees);
      if (glm::length(listener - source) < 0.3f) continue;
      const double free = 1 / (4 * std::numbers::pi * glm::length(listener - source));
      for (const std::size_t band : {0u, 2u, 4u})  // 125, 500, 2000 Hz
        EXPECT_NEAR(rooms::amplitude_db(std::abs(pressure(scene, candidates, listener, band)) / free), 0, 1.0)
            << thick << " " << degrees << " " << band;
    }
  }
}

TEST(O24Babinet, NoJumpAtAnyTransmission) {
  // Shadow boundary behind the edge, reflection boundary in front: on either side of each by a hundredth of a degree.  1 dB is 0.12; the
  // phase between direct and reflected sound turns by 0.04 there at 2 kHz.
  const glm::vec3 source(0.3f, -1, 2.5f);
  const double to_source = std::atan2(2.5, -1.0) * 180 / std::numbers::pi;
  for (const float tau : {0.f, 0.03f, 0.2f, 0.42f, 0.7f, 0.95f, 0.999f}) {
    const AcousticScene scene(screen(tau, false), forced());
    const EarlyCandidates candidates(scene, source);
    for (const double boundary : {to_source - 180, 180 - to_source}) {
      for (const std::size_t band : {0u, 2u, 4u}) {
        const Complex before = pressure(scene, candidates, on_circle(boundary + 0.01), band),
                      after = pressure(scene, candidates, on_circle(boundary - 0.01), band);
        EXPECT_LT(std::abs(before - after) / std::abs(after), 0.06) << tau << " " << boundary << " " << band;
      }
    }
    // And on the way all around, on the boundaries themselves too.
    double last_db = 0;
    for (double degrees = to_source - 20; degrees > -170; degrees -= 0.25) {
      const double level_db = rooms::amplitude_db(std::abs(pressure(scene, candidates, on_circle(degrees), 0)));
      if (degrees < to_source - 20) {
        EXPECT_LT(std::abs(level_db - last_db), 1.0) << tau << " " << degrees;
      }
      last_db = level_db;
    }
  }
}

TEST(O24Babinet, DeepInTheShadowOnlyWhatPassesIsLeft) {
  // tau = 0.1: the wave round the edge has 1 - sqrt(0.1) of the pressure of that of a hard screen's incidence terms.
  const AcousticScene scene(screen(0.1f, false), forced());
  const glm::vec3 source(0, -1, 2.5f), listener(0, -1.5f, -2);
  EnergyResponse response;
  compute_energy_response(scene, EarlyCandidates(scene, source), listener, response);
  ASSERT_EQ(response.arrivals.size(), 2u);
  EXPECT_EQ(response.arrivals[0].kind, ArrivalKind::transmission);
  // By hand: cylindrical coordinates about the edge from the face, in front 0 and behind 2 pi; the reflection terms keep sqrt(1 - tau).
  const double r = std::hypot(1.0, 2.5), s = std::hypot(1.5, 2.0), a = std::atan2(2.5, 1.0),
               b = 2 * std::numbers::pi - std::atan2(2.0, 1.5);
  const double k = 2 * std::numbers::pi * scene.bands().centre_hz[2] / 343, length_m = r * s / (r + s);
  const Complex half = 0.5 * uniform_theory::scaled_erfc(std::sqrt(2 * k * length_m) * std::abs(std::cos((a - b) / 2))),
                mirrored = 0.5 * uniform_theory::scaled_erfc(std::sqrt(2 * k * length_m) * std::abs(std::cos((a + b) / 2)));
  const double sign = std::cos((a + b) / 2) < 0 ? 1 : -1;
  const Complex expected = ((1 - std::sqrt(0.1)) * half + sign * std::sqrt(0.9) * mirrored) / (4 * std::numbers::pi * (r + s));
  EXPECT_NEAR(rooms::amplitude_db(response.arrivals[1].amplitude[2] / std::abs(expected)), 0, 0.05);
}

}  // namespace
}  // namespace earshot
