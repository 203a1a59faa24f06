// SPDX-License-Identifier: Apache-2.0
#include <algorithm>
#include <array>
#include <cmath>
#include <complex>
#include <numbers>
#include <vector>

#include "sim/audio/head/directivity.h"
#include "sim/audio/head/rigid_sphere.h"

namespace earshot {
namespace {

constexpr double kLossBehindDb = 10.0;
constexpr int kVoiceAngles = 91;    ///< every 2 degrees from the front
constexpr int kStepsPerOctave = 3;  ///< of the table of frequencies
constexpr double kLowestHz = 62.5;
constexpr int kFrequencies = 8 * kStepsPerOctave + 1;  ///< up to 16 kHz
/// Frequencies over which the power of one entry is averaged: a third of an octave, which smooths the bright spot behind the sphere.
constexpr int kFrequenciesPerBand = 7;

/// Gains by angle from the front and log frequency.
class Voice final : public Directivity {
 public:
  Voice() {
    std::array<double, kVoiceAngles> angle{};
    for (int i = 0; i < kVoiceAngles; ++i) angle[static_cast<std::size_t>(i)] = std::numbers::pi * i / (kVoiceAngles - 1);
    std::array<std::complex<double>, kVoiceAngles> pressure;
    for (int f = 0; f < kFrequencies; ++f) {
      std::array<double, kVoiceAngles> power{};
      double mean_ka = 0;
      for (int j = 0; j < kFrequenciesPerBand; ++j) {
        const double offset = ((j + 0.5) / kFrequenciesPerBand - 0.5) / kStepsPerOctave;
        const double frequency_hz = kLowestHz * std::exp2(static_cast<double>(f) / kStepsPerOctave + offset);
        const double ka = 2.0 * std::numbers::pi * frequency_hz / kHeadSpeedOfSoundMPerS * kHeadRadiusM;
        mean_ka += ka / kFrequenciesPerBand;
        // By reciprocity the far field of a point source on the sphere is the pressure that a plane wave makes at that point.
        rigid_sphere_pressure(ka, angle, pressure);
        for (std::size_t i = 0; i < kVoiceAngles; ++i) power[i] += std::norm(pressure[i]);
      }
      const double onset = mean_ka * mean_ka / (1.0 + mean_ka * mean_ka);
      for (std::size_t i = 0; i < kVoiceAngles; ++i) {
        const double loss_db = kLossBehindDb * onset * angle[i] / std::numbers::pi;
        gain_.push_back(static_cast<float>(std::sqrt(power[i] / power[0]) * std::pow(10.0, -loss_db / 20.0)));
      }
    }
  }

  [[nodiscard]] float pressure(glm::vec3 direction, float frequency_hz) const override {
    const double angle = std::atan2(std::hypot(direction.x, direction.y), -direction.z) / std::numbers::pi * (kVoiceAngles - 1);
    const double octave = std::log2(std::max(static_cast<double>(frequency_hz), 1.0) / kLowestHz) * kStepsPerOctave;
    const double position = std::clamp(octave, 0.0, kFrequencies - 1.0);
    const int row = std::min(static_cast<int>(position), kFrequencies - 2), column = std::min(static_cast<int>(angle), kVoiceAngles - 2);
    const double up = position - row, across = angle - column;
    const auto at = [&](int r, int c) { return static_cast<double>(gain_[static_cast<std::size_t>(r * kVoiceAngles + c)]); };
    return static_cast<float>((1 - up) * ((1 - across) * at(row, column) + across * at(row, column + 1)) +
                              up * ((1 - across) * at(row + 1, column) + across * at(row + 1, column + 1)));
  }

 private:
  std::vector<float> gain_;  ///< [frequency][angle]
};

}  // namespace

std::shared_ptr<const Directivity> Directivity::voice() { return std::make_shared<const Voice>(); }

}  // namespace earshot
