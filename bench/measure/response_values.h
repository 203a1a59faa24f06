// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <array>
#include <optional>
#include <span>
#include <vector>

#include "bench/measure/error_kinds.h"
#include "sim/acoustics/metrics/interaural_bands.h"
#include "sim/acoustics/metrics/room_metrics.h"

namespace earshot {

/// Everything that is compared at one pose.
struct HeardResponse {
  RoomMetrics energy;                       ///< of the energy response
  std::vector<std::vector<double>> series;  ///< energy_series per band
  RoomMetrics rir;                          ///< of the rendered left ear, octaves
  std::vector<InterauralBand> ears;         ///< of the rendered pair, octaves
  std::vector<float> spectrogram;           ///< pooled log(1 + x)
};

/// The same by kind and band: one item per band (or one), each a number or the samples of a curve, empty where there is no value.
struct ResponseValues {
  std::array<std::vector<std::vector<double>>, kNumErrorKinds> items;
  [[nodiscard]] const std::vector<std::vector<double>>& of(ErrorKind kind) const { return items[static_cast<std::size_t>(kind)]; }
  [[nodiscard]] std::vector<std::vector<double>>& of(ErrorKind kind) { return items[static_cast<std::size_t>(kind)]; }
};
ResponseValues truth_values(const HeardResponse& truth);
/// Of a response that is held against `truth`.  With other bands than the truth's it has no item of the kinds of the energy response: it is
/// compared by what is heard alone.
ResponseValues test_values(const HeardResponse& test, const HeardResponse& truth);

/// Decay curve in dB re its own start, not below kEndedDb; empty without energy.
inline constexpr double kEndedDb = -60;
std::vector<double> decay_levels_db(std::span<const double> series);

/// Product of the differences of draws x, y of a test to estimates a, b of a truth: relative ones, differences, or for curves the mean over
/// the samples at which the truth, the mean of both, is in range (`range_db` below its start or its loudest pixel; before the first arrival
/// a decay curve agrees with any other, which does not count).  The items are not empty but x and y of a curve of decay, which then count
/// as ended.  nullopt where there is nothing to compare.
std::optional<double> difference_product(ErrorKind kind, std::span<const double> x, std::span<const double> y, std::span<const double> a,
                                         std::span<const double> b);
std::optional<double> decay_product(std::span<const double> x, std::span<const double> y, std::span<const double> a,
                                    std::span<const double> b, double range_db);
/// Pixels in dB.
std::optional<double> spectral_product(std::span<const double> x, std::span<const double> y, std::span<const double> a,
                                       std::span<const double> b, double range_db);

}  // namespace earshot
