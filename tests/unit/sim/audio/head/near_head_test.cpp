// SPDX-License-Identifier: Apache-2.0
#include "sim/audio/head/near_head.h"

#include <gtest/gtest.h>

#include <array>
#include <cmath>
#include <numbers>

#include "sim/audio/head/hrtf.h"
#include "sim/audio/head/rigid_sphere.h"
#include "sim/audio/head/sofa_reader.h"
#include "tests/support/acoustics/ears.h"

namespace earshot {
namespace {

constexpr float kRateHz = 25600.f;  // bins of 50 Hz

/// Pressure at a point of a rigid sphere by a series in the classic form j_m - j_m' h_m / h_m', with Bessel functions of the standard
/// library: no code and no recursion of the engine.  Over the free field at the centre.
std::complex<double> exact_pressure(double ka, double kr, double angle_rad) {
  using Complex = std::complex<double>;
  constexpr Complex i(0, 1);
  const auto hankel = [&](unsigned m, double x) { return Complex(std::sph_bessel(m, x), -std::sph_neumann(m, x)); };
  Complex sum = 0;
  for (unsigned m = 0; m < 80; ++m) {
    // f' = m f / x - f_{m+1}
    const Complex slope = m / ka * hankel(m, ka) - hankel(m + 1, ka);
    if (!std::isfinite(std::abs(slope)) || !std::isfinite(std::abs(hankel(m, kr)))) break;
    // j_m h_m' - j_m' h_m = -i / ka^2
    const Complex coefficient = (2.0 * m + 1.0) * hankel(m, kr) * (-i / (ka * ka)) / slope;
    sum += coefficient * std::legendre(m, std::cos(angle_rad));
    if (m > ka + 3 && std::abs(coefficient) < 1e-12) break;
  }
  return -i * kr * std::exp(i * kr) * sum;
}

double octave_power(const std::vector<std::complex<float>>& spectrum, double centre_hz) {
  double sum = 0, count = 0;
  for (auto k = static_cast<std::size_t>(std::ceil(centre_hz / std::numbers::sqrt2 / 50));
       static_cast<double>(k) * 50 < centre_hz * std::numbers::sqrt2; ++k, ++count)
    sum += std::norm(spectrum[k]);
  return sum / count;
}

// Duda and Martens 1998, figure 3 and the limits of the series.
TEST(RigidSphereSeries, OfANearSourceIsTheExactOne) {
  for (const double ka : {0.1, 1.0, 4.0, 12.0}) {
    for (const double rho : {1.5, 3.4, 34.0}) {
      for (const double angle_deg : {0.0, 40.0, 90.0, 150.0, 180.0}) {
        const std::array<double, 1> angle = {angle_deg * kDegree};
        std::array<std::complex<double>, 1> pressure;
        rigid_sphere_pressure(ka, angle, pressure, rho);
        const std::complex<double> expected = exact_pressure(ka, ka * rho, angle[0]);
        EXPECT_NEAR(std::abs(pressure[0] - expected), 0.0, 1e-6 * std::abs(expected) + 1e-6) << ka << ' ' << rho << ' ' << angle_deg;
      }
    }
  }
}

TEST(RigidSphereSeries, OfAFarSourceIsThatOfAPlaneWave) {
  const std::array<double, 3> angles = {0.0, 1.5, 3.0};
  std::array<std::complex<double>, 3> near, far;
  rigid_sphere_pressure(2.0, angles, near, 1e5);
  rigid_sphere_pressure(2.0, angles, far);
  for (std::size_t i = 0; i < 3; ++i) EXPECT_NEAR(std::abs(near[i] - far[i]), 0.0, 1e-4);
}

TEST(RigidSphereSeries, WaveFrontsOfANearSource) {
  EXPECT_NEAR(rigid_sphere_delay(0.0, 3.0), -1.0, 1e-12);
  EXPECT_NEAR(rigid_sphere_delay(std::numbers::pi, 2.0), std::sqrt(3.0) + 2.0 / 3.0 * std::numbers::pi - 2.0, 1e-12);
  for (const double angle : {0.3, 1.5, 2.5}) EXPECT_NEAR(rigid_sphere_delay(angle, 1e6), rigid_sphere_delay(angle), 1e-5);
}

// Issue of the audit: 7.8 dB between the ears at 0.3 m and 250 Hz where the far field has 0.2.
TEST(NearHead, EarsHaveTheLevelsOfTheExactSeries) {
  const auto head = Hrtf::rigid_sphere(kRateHz);
  for (const double distance_m : {0.2, 0.3, 0.5, 1.0, 3.0}) {
    for (const double azimuth_deg : {0.0, 35.0, 60.0, 90.0, 100.0, 135.0, 180.0, -20.0, -90.0}) {
      const Ears e = ears(*head, from_right(azimuth_deg), 0.0, distance_m);
      for (double centre_hz = 125; centre_hz <= 8000; centre_hz *= 2) {
        for (const int ear : {0, 1}) {
          double expected = 0, count = 0;
          double angle = std::abs(azimuth_deg - (ear == 0 ? -100.0 : 100.0));
          if (angle > 180) angle = 360 - angle;
          for (auto k = static_cast<std::size_t>(std::ceil(centre_hz / std::numbers::sqrt2 / 50));
               static_cast<double>(k) * 50 < centre_hz * std::numbers::sqrt2; ++k, ++count) {
            const double wave_number = 2.0 * std::numbers::pi * 50.0 * static_cast<double>(k) / 343.0;
            expected += std::norm(exact_pressure(wave_number * 0.0875, wave_number * distance_m, angle * kDegree));
          }
          const double level = 10.0 * std::log10(octave_power(ear == 0 ? e.left : e.right, centre_hz) * count / expected);
          EXPECT_NEAR(level, 0.0, distance_m < 0.3 ? 2.0 : 1.5)
              << distance_m << " m, " << azimuth_deg << " deg, " << centre_hz << ' ' << ear;
        }
      }
    }
  }
  const Ears near = ears(*head, from_right(90.0), 0.0, 0.3);
  EXPECT_NEAR(10.0 * std::log10(octave_power(near.right, 250) / octave_power(near.left, 250)), 7.8, 0.5);
}

TEST(NearHead, IsContinuousAndEndsWhereItSays) {
  const auto head = Hrtf::rigid_sphere(kRateHz);
  const auto apart = [](const Ears& a, const Ears& b) {
    double most = 0;
    for (std::size_t k = 0; k < 160; ++k)  // below 8 kHz
      most = std::max({most, static_cast<double>(std::abs(a.left[k] - b.left[k])), static_cast<double>(std::abs(a.right[k] - b.right[k]))});
    return most;
  };
  for (const double distance_m : {0.0, 0.05, 0.1249, 0.125, 0.3, 1.0, 2.3, 2.9999})
    EXPECT_LT(apart(ears(*head, from_right(70.0), 0.0, distance_m), ears(*head, from_right(70.0), 0.0, distance_m + 1e-4)), 0.02)
        << distance_m;
  const double infinite = std::numeric_limits<double>::infinity();
  EXPECT_EQ(apart(ears(*head, from_right(70.0), 0.0, 3.0), ears(*head, from_right(70.0), 0.0, infinite)), 0.0);
  EXPECT_EQ(apart(ears(*head, from_right(70.0), 0.0, 0.0), ears(*head, from_right(70.0), 0.0, 0.1)), 0.0);
  // Mirrored sources swap the ears to the bit.
  const Ears right = ears(*head, from_right(50.0), 0.0, 0.4), left = ears(*head, from_right(-50.0), 0.0, 0.4);
  EXPECT_EQ(right.left, left.right);
}

// A head measured at 1.4 m is as it was measured there.
TEST(NearHead, CountsFromTheDistanceOfTheMeasurement) {
  const NearHead near(kRateHz, 512, 1.4), far(kRateHz, 512);
  std::vector<std::complex<float>> ones(257, 1.f), same = ones, raised = ones;
  near.apply(1.4, 0.3, same);
  far.apply(1.4, 0.3, raised);
  for (std::size_t k = 1; k < 160; ++k) EXPECT_NEAR(std::abs(same[k]), 1.0, 0.03) << k;
  EXPECT_GT(std::abs(raised[5]), 1.05);
}

/// A head of two ears without a shadow, in `count` directions.
SofaResponses small_head(float rate_hz) {
  SofaResponses responses;
  responses.sample_rate_hz = rate_hz;
  responses.num_taps = 32;
  for (int i = 0; i < 50; ++i) {
    const double height = (2.0 * i + 1.0) / 50 - 1.0, radius = std::sqrt(1.0 - height * height), angle = 2.4 * i;
    const glm::vec3 direction(radius * std::cos(angle), height, radius * std::sin(angle));
    responses.direction.push_back(direction);
    for (const int ear : {0, 1}) {
      std::vector<float> taps(32, 0.f);
      taps[8] = 1.f;
      taps[9] = 0.3f * (ear == 0 ? -direction.x : direction.x);
      responses.taps.insert(responses.taps.end(), taps.begin(), taps.end());
      responses.delay_samples.push_back(0.f);
    }
  }
  return responses;
}

// Above the band of a measurement there is nothing, and nothing that is not finite.
TEST(Hrtf, RatesAboveThatOfTheMeasurement) {
  for (const float rate_hz : {16000.f, 44100.f, 48000.f, 96000.f}) {
    const auto head = Hrtf::from_responses(small_head(16000.f), rate_hz, "test");
    const double bin_hz = static_cast<double>(rate_hz) / head->fft_size();
    double inside = 0, beyond = 0;
    for (int channel = 0; channel < 4; ++channel) {
      for (int ear = 0; ear < 2; ++ear) {
        const auto decoder = head->diffuse_decoder(channel, ear);
        for (std::size_t k = 0; k < decoder.size(); ++k) {
          ASSERT_TRUE(std::isfinite(std::abs(decoder[k]))) << rate_hz << ' ' << k;
          const double frequency_hz = static_cast<double>(k) * bin_hz;
          if (frequency_hz > 500 && frequency_hz < 7000) inside += std::norm(decoder[k]) * bin_hz / 6500;
          if (frequency_hz > 9000) beyond += std::norm(decoder[k]) * bin_hz / 6500;
        }
      }
    }
    // The covariance of the head, whose level is that of the rigid sphere: two ears of power one or a little more.
    EXPECT_NEAR(10.0 * std::log10(0.5 * inside), 1.3, 1.3) << rate_hz;
    EXPECT_LT(beyond, 1e-3 * inside) << rate_hz;
  }
}

}  // namespace
}  // namespace earshot
