// SPDX-License-Identifier: Apache-2.0
#include "sim/acoustics/metrics/late_errors.h"

#include <gtest/gtest.h>

#include <array>
#include <cmath>
#include <numbers>

#include "sim/acoustics/core/jackknife.h"
#include "sim/acoustics/response/scattered_energy.h"
#include "tests/support/acoustics/rooms.h"

namespace earshot {
namespace {

constexpr int kBatches = 16;

/// Batches of different energy in one bin, and a panel that scatters `scattered` of energy into another.
EnergyResponse response_of(const AcousticScene& scene, float scattered, std::array<double, kBatches>& batch_energy) {
  EnergyResponse response;
  response.speed_of_sound_m_per_s = 343.f;
  response.late = EnergyHistogram(50, scene.num_bands(), 1, 0.004f);
  LateBatches& batches = response.batches;
  batches.count = kBatches, batches.num_bins = 50, batches.num_bands = scene.num_bands();
  batches.energy.assign(static_cast<std::size_t>(kBatches * 50 * scene.num_bands()), 0.f);
  for (int i = 0; i < kBatches; ++i) {
    batch_energy[static_cast<std::size_t>(i)] = 1e-3 * (1 + 0.05 * (i % 5 - 2));
    for (int band = 0; band < scene.num_bands(); ++band) {
      const auto energy = static_cast<float>(batch_energy[static_cast<std::size_t>(i)]);
      batches.energy[static_cast<std::size_t>((i * 50 + 20) * scene.num_bands() + band)] = energy;
      response.late.values()[static_cast<std::size_t>((20 * scene.num_bands() + band) * 4)] += energy / kBatches;
    }
  }
  Arrival panel;
  panel.distance_m = 10.f;
  panel.amplitude.fill(std::sqrt(scattered));
  response.scattered.push_back(panel);
  add_scattered_energy(response.scattered, 343.f, response.late);
  return response;
}

// Closed form: G is 10 lg of the sum, of which the scattered part is in every batch.  Nine times the late energy makes errors of G ten
// times smaller; leaving it out would give the error of the late energy alone.
TEST(LateErrors, WhatPanelsScatterBelongsToEveryBatch) {
  AcousticConfig config;
  config.air_absorption = Switch::off;
  const AcousticScene scene(rooms::box(6, 5, 3, rooms::uniform_walls(0.2, 0.5)), config);
  for (const float scattered : {0.f, 9e-3f}) {
    std::array<double, kBatches> energy{};
    const EnergyResponse response = response_of(scene, scattered, energy);
    const auto errors = late_errors(scene, response);
    double sum = 0;
    for (const double e : energy) sum += e;
    std::vector<std::optional<double>> without;
    for (const double e : energy) without.emplace_back(10 * std::log10((sum - e) / (kBatches - 1) + static_cast<double>(scattered)));
    // 97.5 % of Student's distribution with 15 degrees of freedom is 2.1314, of Gauss's 1.9600.
    const double expected = *jackknife_error(without) * 2.1314 / 1.9600;
    for (const BandErrors& band : errors) {
      ASSERT_TRUE(band.g_error_db.has_value());
      EXPECT_NEAR(*band.g_error_db / expected, 1.0, 0.01) << scattered;
      EXPECT_NEAR(band.late_energy / (sum / kBatches + static_cast<double>(scattered)), 1.0, 1e-5);
    }
  }
}

}  // namespace
}  // namespace earshot
