// SPDX-License-Identifier: Apache-2.0
#include "sim/audio/transforms/low_pass.h"

#include <cmath>
#include <cstddef>
#include <numbers>

#include "sim/base/errors.h"

namespace earshot {
namespace {

/// Quality factors of the pairs of poles of a Butterworth filter of fourth order: 1 / (2 cos(pi / 8)) and 1 / (2 cos(3 pi / 8)).
constexpr std::array<double, 2> kQuality = {0.54119610014619698, 1.3065629648763766};
/// Time constants down to -80 dB: ln 10^4.
constexpr double kTimeConstants = 9.2103403719761836;

}  // namespace

LowPass::LowPass(double cutoff_hz, double sample_rate_hz) : rate_hz_(sample_rate_hz) {
  EARSHOT_EXPECT(cutoff_hz > 0 && cutoff_hz < sample_rate_hz / 2);
  const double omega = 2 * std::numbers::pi * cutoff_hz / sample_rate_hz, cosine = std::cos(omega);
  for (std::size_t i = 0; i < sections_.size(); ++i) {
    const double alpha = std::sin(omega) / (2 * kQuality[i]), a0 = 1 + alpha, b = (1 - cosine) / (2 * a0);
    sections_[i] = {.b0 = b, .b1 = 2 * b, .b2 = b, .a1 = -2 * cosine / a0, .a2 = (1 - alpha) / a0};
  }
  // The amplitude of the narrower pair of poles falls by sqrt(a2) in each sample.
  ring_samples_ = kTimeConstants / (-0.5 * std::log(sections_[1].a2));
}

void LowPass::filter(std::span<float> samples) const {
  for (const Biquad& s : sections_) {
    double z1 = 0, z2 = 0;
    for (float& sample : samples) {
      const double x = static_cast<double>(sample), y = s.b0 * x + z1;
      z1 = s.b1 * x - s.a1 * y + z2;
      z2 = s.b2 * x - s.a2 * y;
      sample = static_cast<float>(y);
    }
  }
}

std::complex<double> LowPass::response(double frequency_hz) const {
  const std::complex<double> z = std::polar(1.0, -2 * std::numbers::pi * frequency_hz / rate_hz_);
  std::complex<double> product = 1;
  for (const Biquad& s : sections_) product *= (s.b0 + z * (s.b1 + z * s.b2)) / (1.0 + z * (s.a1 + z * s.a2));
  return product;
}

}  // namespace earshot
