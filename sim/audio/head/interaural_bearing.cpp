// SPDX-License-Identifier: Apache-2.0
#include "sim/audio/head/interaural_bearing.h"

#include <algorithm>
#include <cmath>
#include <numbers>

#include "sim/audio/head/rigid_sphere.h"
#include "sim/base/errors.h"

namespace earshot {
namespace {

constexpr double kFrame_s = 0.032;
/// Below, the ears differ by less than what reverberation does to them; above, little of most sounds is left.
constexpr double kLowest_hz = 200, kHighest_hz = 7000;
constexpr float kRange_db = 45;  ///< bins further below the loudest do not count
constexpr float kLevelTolerance_db = 8, kLevelWeight = 0.3f;
constexpr float kMinPower = 1e-20f;

int frame_size(float sample_rate_hz) {
  return next_power_of_two(static_cast<int>(std::lround(kFrame_s * static_cast<double>(sample_rate_hz))));
}

/// From the largest value, at `best`, to the vertex of the parabola through it and its neighbours; in steps, at most half of one.
double offset_of_peak(std::span<const float> response, std::size_t best) {
  if (best == 0 || best + 1 >= response.size()) return 0;
  const double before = response[best - 1], at = response[best], after = response[best + 1], bend = before - 2 * at + after;
  return bend < 0 ? std::clamp(0.5 * (before - after) / bend, -0.5, 0.5) : 0.0;
}

}  // namespace

double InterauralBearing::angle_rad(int i) { return std::numbers::pi * (static_cast<double>(i) / (kNumAngles - 1) - 0.5); }

InterauralBearing::InterauralBearing(float sample_rate_hz) : fft_(frame_size(sample_rate_hz)) {
  const auto size = static_cast<std::size_t>(fft_.size());
  const double bin_hz = static_cast<double>(sample_rate_hz) / static_cast<double>(size);
  first_bin_ = static_cast<std::size_t>(std::ceil(kLowest_hz / bin_hz));
  const auto last = std::min(size / 2 - 1, static_cast<std::size_t>(kHighest_hz / bin_hz));
  num_bins_ = last - first_bin_ + 1;
  window_.resize(size);
  for (std::size_t i = 0; i < size; ++i)
    window_[i] =
        static_cast<float>(0.5 - 0.5 * std::cos(2.0 * std::numbers::pi * (static_cast<double>(i) + 0.5) / static_cast<double>(size)));
  frame_.resize(size);
  left_.resize(size / 2 + 1);
  right_.resize(size / 2 + 1);
  cross_.resize(num_bins_);
  power_left_.resize(num_bins_);
  power_right_.resize(num_bins_);
  steer_.resize(kNumAngles * num_bins_);
  level_db_.resize(kNumAngles * num_bins_);
  // The ears are at +-90 degrees: incidences of the left and the right ear for each angle.
  std::vector<double> incidence(2 * kNumAngles);
  for (int i = 0; i < kNumAngles; ++i) {
    incidence[2 * static_cast<std::size_t>(i)] = 0.5 * std::numbers::pi - angle_rad(i);
    incidence[2 * static_cast<std::size_t>(i) + 1] = 0.5 * std::numbers::pi + angle_rad(i);
  }
  std::vector<std::complex<double>> pressure(incidence.size());
  for (std::size_t k = 0; k < num_bins_; ++k) {
    const double frequency_hz = static_cast<double>(first_bin_ + k) * bin_hz;
    rigid_sphere_pressure(2.0 * std::numbers::pi * frequency_hz * kHeadRadiusM / kHeadSpeedOfSoundMPerS, incidence, pressure);
    for (std::size_t i = 0; i < kNumAngles; ++i) {
      const std::complex<double> ratio = pressure[2 * i] / pressure[2 * i + 1];
      steer_[i * num_bins_ + k] = std::complex<float>(ratio / std::abs(ratio));
      level_db_[i * num_bins_ + k] = static_cast<float>(20.0 * std::log10(std::abs(ratio)));
    }
  }
}

InterauralBearing::Estimate InterauralBearing::estimate(std::span<const float> sound, std::span<float> response) {
  EARSHOT_EXPECT(response.size() == kNumAngles && sound.size() / 2 >= frame_.size());
  std::ranges::fill(response, 0.f);
  add_frames(sound);
  const float loudest = loudest_power();
  if (!(loudest > kMinPower)) return {};
  const BinSums sums = steer(loudest * std::pow(10.f, -0.1f * kRange_db), response);
  if (!(sums.weights > 0)) return {};
  for (float& r : response) r = static_cast<float>(static_cast<double>(r) / sums.weights);
  const auto best = static_cast<std::size_t>(std::ranges::max_element(response) - response.begin());
  const double step_rad = std::numbers::pi / (kNumAngles - 1);
  return {.lateral_rad = angle_rad(static_cast<int>(best)) + offset_of_peak(response, best) * step_rad,
          .agreement = static_cast<double>(response[best]),
          .coherence = sums.coherences / static_cast<double>(sums.num_bins),
          .silent = false};
}

/// Sums powers and cross spectra over half-overlapping frames.
void InterauralBearing::add_frames(std::span<const float> sound) {
  const std::size_t samples = sound.size() / 2, size = frame_.size();
  std::ranges::fill(cross_, std::complex<float>{});
  std::ranges::fill(power_left_, 0.f);
  std::ranges::fill(power_right_, 0.f);
  const auto transform = [&](std::size_t ear, std::size_t start, std::span<std::complex<float>> spectrum) {
    for (std::size_t i = 0; i < size; ++i) frame_[i] = window_[i] * sound[ear * samples + start + i];
    fft_.forward(frame_, spectrum);
  };
  for (std::size_t start = 0; start + size <= samples; start += size / 2) {
    transform(0, start, left_);
    transform(1, start, right_);
    for (std::size_t k = 0; k < num_bins_; ++k) {
      const std::complex<float> l = left_[first_bin_ + k], r = right_[first_bin_ + k];
      cross_[k] += l * std::conj(r);
      power_left_[k] += std::norm(l);
      power_right_[k] += std::norm(r);
    }
  }
}

/// Largest power of one bin, both ears summed.
float InterauralBearing::loudest_power() const {
  float loudest = 0;
  for (std::size_t k = 0; k < num_bins_; ++k) loudest = std::max(loudest, power_left_[k] + power_right_[k]);
  return loudest;
}

/// Adds to the response of each angle the fit of phases and levels of all bins from least_power on.
InterauralBearing::BinSums InterauralBearing::steer(float least_power, std::span<float> response) const {
  BinSums sums;
  for (std::size_t k = 0; k < num_bins_; ++k) {
    if (power_left_[k] + power_right_[k] < least_power) continue;
    const float left = power_left_[k] + 1e-3f * least_power, right = power_right_[k] + 1e-3f * least_power;
    const float magnitude = std::abs(cross_[k]);
    const float coherence = std::min(1.f, magnitude / std::sqrt(left * right));
    sums.coherences += static_cast<double>(coherence);
    ++sums.num_bins;
    if (!(magnitude > 0)) continue;
    // Phase transform: every bin counts the same, but for the diffuse ones.
    const float weight = coherence * coherence;
    sums.weights += static_cast<double>(weight);
    const std::complex<float> phase = cross_[k] / magnitude;
    const float difference_db = 10.f * std::log10(left / right);
    for (std::size_t i = 0; i < kNumAngles; ++i) {
      const std::complex<float> expected = steer_[i * num_bins_ + k];
      const float aligned = phase.real() * expected.real() + phase.imag() * expected.imag();
      const float off = std::min(1.f, std::abs(difference_db - level_db_[i * num_bins_ + k]) / kLevelTolerance_db);
      response[i] += weight * ((1 - kLevelWeight) * aligned + kLevelWeight * (1 - 2 * off));
    }
  }
  return sums;
}

}  // namespace earshot
