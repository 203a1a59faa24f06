// SPDX-License-Identifier: Apache-2.0
#include "sim/audio/head/near_head.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <numbers>

#include "sim/audio/head/rigid_sphere.h"
#include "sim/audio/transforms/spectrum_math.h"

namespace earshot {
namespace {

using Complex = std::complex<float>;

/// Distances of the table in geometric steps; the last one is kFarFieldM, where the ratio is set to one.
constexpr int kDistances = 14;
constexpr std::size_t kAngles = 61;  ///< three degrees apart
constexpr double kAngleStep = std::numbers::pi / (kAngles - 1);
/// In the shadow far and near fields have their nulls at different places: no ratio beyond 20 dB.
constexpr double kLargestRatio = 10.0;

}  // namespace

NearHead::NearHead(float sample_rate_hz, int fft_size, double measured_m)
    : num_bins_(static_cast<std::size_t>(fft_size / 2 + 1)),
      rate_hz_(static_cast<double>(sample_rate_hz)),
      measured_m_(std::max(measured_m, kNearestM)),
      ratio_(kDistances * kAngles * num_bins_, Complex(1.f)) {
  for (int i = 0; i < kDistances; ++i) distance_m_.push_back(kNearestM * std::pow(kFarFieldM / kNearestM, i / (kDistances - 1.0)));
  std::vector<double> angles;
  for (std::size_t i = 0; i < kAngles; ++i) angles.push_back(kAngleStep * static_cast<double>(i));
  std::vector<std::complex<double>> near(kAngles), far(kAngles);
  for (std::size_t k = 1; k < num_bins_; ++k) {
    const double frequency_hz = static_cast<double>(k) * rate_hz_ / fft_size;
    const double ka = 2.0 * std::numbers::pi * frequency_hz / kHeadSpeedOfSoundMPerS * kHeadRadiusM;
    rigid_sphere_pressure(ka, angles, far, measured_m_ / kHeadRadiusM);
    for (std::size_t d = 0; d + 1 < distance_m_.size(); ++d) {
      rigid_sphere_pressure(ka, angles, near, distance_m_[d] / kHeadRadiusM);
      for (std::size_t a = 0; a < kAngles; ++a) {
        const double later =
            rigid_sphere_delay(angles[a], distance_m_[d] / kHeadRadiusM) - rigid_sphere_delay(angles[a], measured_m_ / kHeadRadiusM);
        const double floor = std::abs(near[a]) / kLargestRatio;
        const std::complex<double> below = std::abs(far[a]) < floor ? far[a] * (floor / std::max(std::abs(far[a]), 1e-12)) : far[a];
        const std::complex<double> ratio = near[a] / below * std::polar(1.0, ka * later);
        ratio_[(d * kAngles + a) * num_bins_ + k] = Complex(ratio);
      }
    }
  }
  // No phase at 0 Hz: the limit of a sphere that is small against every wavelength.
  for (std::size_t r = 0; r < distance_m_.size() * kAngles; ++r) ratio_[r * num_bins_] = std::abs(ratio_[r * num_bins_ + 1]);
}

std::span<const Complex> NearHead::row(std::size_t distance, std::size_t angle) const {
  return std::span(ratio_).subspan((distance * kAngles + angle) * num_bins_, num_bins_);
}

double NearHead::apply(double distance_m, double angle_rad, std::span<Complex> spectrum) const {
  if (!applies(distance_m)) return 0;
  const double distance = std::max(distance_m, kNearestM);
  const double at = std::log(distance / kNearestM) / std::log(kFarFieldM / kNearestM) * (kDistances - 1);
  const auto d = static_cast<std::size_t>(std::clamp(at, 0.0, kDistances - 2.0));
  const double position = std::clamp(angle_rad / kAngleStep, 0.0, static_cast<double>(kAngles - 1));
  const auto a = static_cast<std::size_t>(std::min(position, static_cast<double>(kAngles - 2)));
  const auto x = static_cast<float>(at - static_cast<double>(d)), y = static_cast<float>(position - static_cast<double>(a));
  const Complex *p = row(d, a).data(), *q = row(d, a + 1).data(), *r = row(d + 1, a).data(), *s = row(d + 1, a + 1).data();
  const float wp = (1 - x) * (1 - y), wq = (1 - x) * y, wr = x * (1 - y), ws = x * y;
  for (std::size_t k = 0; k < num_bins_; ++k) spectrum[k] = multiply(spectrum[k], wp * p[k] + wq * q[k] + wr * r[k] + ws * s[k]);
  // The wave front of the near source against that of the far one; it fades out with the table, whose last row is one.
  const double last = distance_m_[kDistances - 2];
  const double weight = distance <= last ? 1.0 : 1.0 - static_cast<double>(x);
  const double later = rigid_sphere_delay(angle_rad, distance / kHeadRadiusM) - rigid_sphere_delay(angle_rad, measured_m_ / kHeadRadiusM);
  return weight * later * kHeadRadiusM / kHeadSpeedOfSoundMPerS * rate_hz_;
}

}  // namespace earshot
