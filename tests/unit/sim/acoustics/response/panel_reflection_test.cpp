// SPDX-License-Identifier: Apache-2.0
#include "sim/acoustics/paths/panel_reflection.h"

#include <gtest/gtest.h>

#include <cmath>
#include <numbers>

#include "sim/acoustics/response/energy_response.h"
#include "tests/support/acoustics/rigid_plate.h"
#include "tests/support/acoustics/rooms.h"

namespace earshot {
namespace {

constexpr double kPi = std::numbers::pi;

std::shared_ptr<const Scene> plate(float width_m, float depth_m) {
  TriangleMesh mesh;
  const float x = width_m / 2, z = depth_m / 2;
  rooms::append_quad(mesh, {glm::vec3(-x, 0, -z), glm::vec3(-x, 0, z), glm::vec3(x, 0, z), glm::vec3(x, 0, -z)}, 0);
  return rooms::scene_of(std::move(mesh), {Material::uniform("rigid", 0.f, 0.f)});
}

AcousticConfig without_late(Switch diffraction) {
  AcousticConfig config;
  config.rays = 64;
  config.diffraction = diffraction;
  config.air_absorption = Switch::off;
  config.late = Switch::off;
  return config;
}

const Arrival* image(const EnergyResponse& response) {
  for (const Arrival& arrival : response.arrivals)
    if (arrival.kind == ArrivalKind::reflection) return &arrival;
  return nullptr;
}

TEST(PanelReflection, PlatesAgainstKirchhoff) {
  // Octaves of 125 Hz to 4 kHz, plates of 0.5 to 2 m, the point of reflection in the middle and off it.  With few edges and with all.
  for (const float width_m : {0.5f, 1.f, 2.f}) {
    for (const float depth_m : {0.5f, 1.f, 2.f}) {
      for (const double degrees : {0., 40.}) {
        for (const double off_middle : {0., 0.15}) {
          const double a = degrees * kPi / 180;
          const glm::dvec3 source(-3 * std::sin(a) + off_middle * width_m, 3 * std::cos(a), 0.1),
              listener(4 * std::sin(a) + off_middle * width_m, 4 * std::cos(a), 0);
          for (const Switch diffraction : {Switch::automatic, Switch::on}) {
            const AcousticScene scene(plate(width_m, depth_m), without_late(diffraction));
            EnergyResponse response;
            compute_energy_response(scene, EarlyCandidates(scene, glm::vec3(source)), glm::vec3(listener), response);
            const Arrival* found = image(response);
            ASSERT_NE(found, nullptr);
            for (std::size_t band = 0; band < 6; ++band) {
              const double exact = rigid_plate::octave_energy(width_m, depth_m, source, listener, scene.bands().centre_hz[band], 343);
              const double off_db = 10 * std::log10(found->amplitude[band] * found->amplitude[band] / exact);
              EXPECT_LT(std::abs(off_db), 1.5) << width_m << " " << depth_m << " " << degrees << " " << off_middle << " band " << band;
            }
          }
        }
      }
    }
  }
}

TEST(PanelReflection, WhatIsNotReflectedIsScattered) {
  AcousticConfig config = without_late(Switch::automatic);
  config.late = Switch::automatic;
  const AcousticScene scene(plate(0.5f, 0.5f), config);
  EnergyResponse response;
  compute_energy_response(scene, EarlyCandidates(scene, glm::vec3(-1, 2, 0)), {1, 2, 0}, response);
  const Arrival* found = image(response);
  ASSERT_NE(found, nullptr);
  ASSERT_EQ(response.scattered.size(), 1u);
  const double whole = 1 / std::pow(4 * kPi * double{found->distance_m}, 2);
  const double reflected = double{found->amplitude[0]} * found->amplitude[0],
               scattered = double{response.scattered[0].amplitude[0]} * response.scattered[0].amplitude[0];
  EXPECT_LT(reflected, 0.1 * whole);  // 125 Hz
  EXPECT_NEAR((reflected + scattered) / whole, 1, 1e-5);
  double late = 0;
  for (int bin = 0; bin < response.late.num_bins(); ++bin) late += response.late.energy(bin, 0);
  EXPECT_NEAR(late / scattered, 1, 0.05);  // nothing else comes back from a plate that does not scatter
}

}  // namespace
}  // namespace earshot
