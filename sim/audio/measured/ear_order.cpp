// SPDX-License-Identifier: Apache-2.0
#include "sim/audio/measured/ear_order.h"

#include <algorithm>
#include <array>
#include <cmath>

namespace earshot {
namespace {

/// A head has 5 dB and 300 us; a pair of free microphones nothing.
constexpr double kClearDb = 1.0, kClearS = 50e-6;
constexpr float kLateral = 0.3f;

/// First sample at which a response reaches a part of its peak.
double first_rise(std::span<const float> response) {
  float peak = 0;
  for (const float value : response) peak = std::max(peak, std::abs(value));
  for (std::size_t i = 0; i < response.size(); ++i)
    if (std::abs(response[i]) >= 0.15f * peak) return static_cast<double>(i);
  return 0;
}

int sign_beyond(double value, double limit) { return value > limit ? 1 : value < -limit ? -1 : 0; }

}  // namespace

int EarEvidence::first_is_left() const {
  const int by_level = sign_beyond(level_db, kClearDb), by_onset = sign_beyond(early_s, kClearS);
  return by_level * by_onset < 0 ? 0 : by_level != 0 ? by_level : by_onset;
}

EarEvidence weigh_ears(std::span<const glm::vec3> direction, std::span<const float> taps, int num_taps,
                       std::span<const float> delay_samples, double sample_rate_hz) {
  struct Half {
    double count = 0, level_db = 0, early_s = 0;
  };
  std::array<Half, 2> halves;  // sources on the left, on the right
  const auto length = static_cast<std::size_t>(num_taps);
  for (std::size_t m = 0; m < direction.size(); ++m) {
    if (std::abs(direction[m].x) < kLateral) continue;
    std::array<double, 2> energy{}, onset{};
    for (std::size_t ear = 0; ear < 2; ++ear) {
      const auto response = taps.subspan((2 * m + ear) * length, length);
      for (const float value : response) energy[ear] += static_cast<double>(value) * static_cast<double>(value);
      onset[ear] = first_rise(response) + static_cast<double>(delay_samples[2 * m + ear]);
    }
    if (!(energy[0] > 0 && energy[1] > 0)) continue;
    Half& half = halves[direction[m].x < 0 ? 0 : 1];
    half.count += 1;
    half.level_db += 10.0 * std::log10(energy[0] / energy[1]);
    half.early_s += (onset[1] - onset[0]) / sample_rate_hz;
  }
  // The difference of the halves leaves out what one ear has on both sides: the gain of its microphone, the delay of its converter.
  EarEvidence evidence;
  const double num_halves = (halves[0].count > 0 ? 1.0 : 0.0) + (halves[1].count > 0 ? 1.0 : 0.0);
  for (std::size_t side = 0; side < 2; ++side) {
    if (!(halves[side].count > 0)) continue;
    const double weight = (side == 0 ? 1.0 : -1.0) / (halves[side].count * num_halves);
    evidence.level_db += weight * halves[side].level_db;
    evidence.early_s += weight * halves[side].early_s;
  }
  return evidence;
}

}  // namespace earshot
