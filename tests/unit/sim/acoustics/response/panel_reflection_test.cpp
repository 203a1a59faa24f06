// SPDX-License-Identifier: Apache-2.0
#include "sim/acoustics/paths/panel_reflection.h"

#include <gtest/gtest.h>

#include <array>
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

/// Energy of octaves of 125, 250 and 500 Hz, in dB over an endless plane's, by boundary elements in three dimensions
/// (tests/validation/rigid_plates.py).  By width, by depth, by angle (0, 40 degrees), by the point of reflection (middle, 0.15 of the width
/// off it).
constexpr std::array<std::array<double, 3>, 36> kByElementsDb = {
    {{-34.11, -19.76, -11.46}, {-34.12, -19.77, -11.48}, {-38.87, -25.12, -15.32}, {-38.80, -25.04, -15.26}, {-25.07, -11.51, -6.08},
     {-25.07, -11.52, -6.10},  {-29.87, -16.98, -9.19},  {-29.80, -16.90, -9.13},  {-17.51, -5.65, -3.03},   {-17.52, -5.66, -3.05},
     {-22.34, -11.14, -6.16},  {-22.28, -11.08, -6.14},  {-25.06, -11.50, -6.05},  {-25.11, -11.59, -6.37},  {-29.99, -16.65, -7.45},
     {-29.86, -16.54, -7.47},  {-13.76, -5.48, -0.56},   {-13.81, -5.57, -0.90},   {-18.95, -8.98, -1.97},   {-18.82, -8.89, -2.01},
     {-5.75, -0.51, 2.20},     {-5.79, -0.60, 1.89},     {-11.00, -3.38, 1.11},    {-10.87, -3.30, 1.02},    {-17.51, -5.62, -2.93},
     {-17.84, -6.74, -5.29},   {-22.17, -8.85, -1.95},   {-22.07, -9.19, -4.05},   {-5.74, -0.48, 2.26},     {-6.08, -1.64, -0.01},
     {-10.17, -1.23, 2.76},    {-10.06, -1.66, 0.55},    {0.18, 4.50, 5.41},       {-0.16, 3.31, 3.03},      {-2.58, 3.76, 5.64},
     {-2.52, 3.23, 3.48}}};

TEST(PanelReflection, PlatesAgainstBoundaryElementsAndKirchhoff) {
  // Octaves of 125 Hz to 4 kHz, plates of 0.5 to 2 m, the point of reflection in the middle and off it.  With few edges and with all.
  // Kirchhoff's approximation is good where the plate is large against the wave: from 1 kHz on.
  std::size_t row = 0;
  for (const float width_m : {0.5f, 1.f, 2.f}) {
    for (const float depth_m : {0.5f, 1.f, 2.f}) {
      for (const double degrees : {0., 40.}) {
        for (const double off_middle : {0., 0.15}) {
          const double a = degrees * kPi / 180;
          const glm::dvec3 source(-3 * std::sin(a) + off_middle * width_m, 3 * std::cos(a), 0.1),
              listener(4 * std::sin(a) + off_middle * width_m, 4 * std::cos(a), 0);
          const double endless = 1 / std::pow(4 * kPi * glm::length(listener - source * glm::dvec3(1, -1, 1)), 2);
          for (const Switch diffraction : {Switch::automatic, Switch::on}) {
            const AcousticScene scene(plate(width_m, depth_m), without_late(diffraction));
            EnergyResponse response;
            compute_energy_response(scene, EarlyCandidates(scene, glm::vec3(source)), glm::vec3(listener), response);
            const Arrival* found = image(response);
            ASSERT_NE(found, nullptr);
            for (std::size_t band = 0; band < 6; ++band) {
              const double exact = band < 3
                                       ? endless * std::pow(10, kByElementsDb[row][band] / 10)
                                       : rigid_plate::octave_energy(width_m, depth_m, source, listener, scene.bands().centre_hz[band], 343);
              const double off_db = 10 * std::log10(found->amplitude[band] * found->amplitude[band] / exact);
              EXPECT_LT(std::abs(off_db), 1.5) << width_m << " " << depth_m << " " << degrees << " " << off_middle << " band " << band;
            }
          }
          ++row;
        }
      }
    }
  }
}

TEST(PanelReflection, WhatPassesASmallPanelIsNotReflected) {
  // At 125 Hz a plate of 0.5 m reflects next to nothing (0.2 % of what falls on it): neither as an image nor as late energy.
  AcousticConfig config = without_late(Switch::automatic);
  config.late = Switch::automatic;
  const AcousticScene scene(plate(0.5f, 0.5f), config);
  EnergyResponse response;
  compute_energy_response(scene, EarlyCandidates(scene, glm::vec3(-1, 2, 0)), {1, 2, 0}, response);
  const Arrival* found = image(response);
  ASSERT_NE(found, nullptr);
  EXPECT_TRUE(response.scattered.empty());
  const double whole = 1 / std::pow(4 * kPi * double{found->distance_m}, 2);
  EXPECT_LT(double{found->amplitude[0]} * found->amplitude[0], 0.01 * whole);
  double late = 0;
  for (int bin = 0; bin < response.late.num_bins(); ++bin) late += response.late.energy(bin, 0);
  EXPECT_LT(late, 1e-6 * whole);  // nothing else comes back from a plate that does not scatter
}

TEST(PanelReflection, PathsOfTwoMirrorsKeepNoMoreThanThePanelReflects) {
  // A plate of 1 m and a wall of 20 x 20 m at right angles to it: images of both, in either order.
  TriangleMesh mesh;
  rooms::append_quad(mesh, {glm::vec3(-0.5, 0, -0.5), glm::vec3(-0.5, 0, 0.5), glm::vec3(0.5, 0, 0.5), glm::vec3(0.5, 0, -0.5)}, 0);
  rooms::append_quad(mesh, {glm::vec3(-0.8f, -10, -10), glm::vec3(-0.8f, -10, 10), glm::vec3(-0.8f, 10, 10), glm::vec3(-0.8f, 10, -10)}, 0);
  AcousticConfig config = without_late(Switch::automatic);
  config.late = Switch::automatic;
  config.early_order = 2;
  const AcousticScene scene(rooms::scene_of(std::move(mesh), {Material::uniform("rigid", 0.f, 0.f)}), config);
  ASSERT_EQ(scene.panel_shapes()->all().size(), 2u);  // both sides of the plate
  const PanelShape& shape = scene.panel_shapes()->all()[0];
  int seen = 0;
  for (const float x : {0.5f, 0.6f, 0.7f, 0.9f}) {
    EnergyResponse response;
    compute_energy_response(scene, EarlyCandidates(scene, glm::vec3(x, 2, 0.1f)), {-0.4f, 1.5f, 0}, response);
    for (const Arrival& scattered : response.scattered) {
      if (scattered.order != 2) continue;
      ++seen;
      for (std::size_t band = 0; band < 6; ++band) {
        const double k = 2 * kPi * scene.bands().centre_hz[band] / 343, whole = 1 / std::pow(4 * kPi * double{scattered.distance_m}, 2);
        double kept = double{scattered.amplitude[band]} * scattered.amplitude[band];
        for (const Arrival& path : response.arrivals)
          if (path.identity == scattered.identity) kept += double{path.amplitude[band]} * path.amplitude[band];
        EXPECT_GE(kept, 0.99 * reflected_fraction(shape, k, 0.5) * whole);
        EXPECT_LE(kept, 2.6 * whole);  // 4 dB in the middle of a panel
      }
    }
  }
  EXPECT_GT(seen, 0);
}

}  // namespace
}  // namespace earshot
