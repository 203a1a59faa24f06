// SPDX-License-Identifier: Apache-2.0
#include "sim/audio/head/interaural_bearing.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <complex>
#include <numbers>
#include <vector>

#include "sim/audio/head/rigid_sphere.h"
#include "sim/audio/transforms/fft.h"
#include "sim/base/random.h"
#include "tests/support/acoustics/directions.h"

namespace earshot {
namespace {

constexpr float kRate_hz = 16000;

/// White noise at two ears that delay it by these seconds.
std::vector<float> delayed_noise(double left_s, double right_s, std::size_t samples) {
  RealFft fft(next_power_of_two(static_cast<int>(samples)));
  std::vector<float> noise(static_cast<std::size_t>(fft.size()));
  const RandomStream random(3, Purpose::test);
  for (std::size_t i = 0; i < noise.size(); ++i) noise[i] = random.normal2(static_cast<std::uint32_t>(i))[0];
  std::vector<std::complex<float>> spectrum(static_cast<std::size_t>(fft.num_bins())), shifted(spectrum.size());
  fft.forward(noise, spectrum);
  std::vector<float> sound(2 * samples), ear(noise.size());
  for (std::size_t e = 0; e < 2; ++e) {
    const double delay_s = e == 0 ? left_s : right_s;
    for (std::size_t k = 0; k < spectrum.size(); ++k)
      shifted[k] = spectrum[k] *
                   std::complex<float>(std::polar(1.0, -2.0 * std::numbers::pi * static_cast<double>(k) * kRate_hz / fft.size() * delay_s));
    fft.inverse(shifted, ear);
    std::copy_n(ear.begin(), samples, sound.begin() + static_cast<std::ptrdiff_t>(e * samples));
  }
  return sound;
}

// Delays of Woodworth (1938) alone, without the low frequencies' larger ones and without level differences: a model that the estimator does
// not steer with.  10 degrees: the angle between a source that an agent walks to and one that it passes at 0.7 m from 4 m away.
TEST(InterauralBearing, FindsTheAngleOfWoodworthsDelays) {
  InterauralBearing ears(kRate_hz);
  std::vector<float> response(InterauralBearing::kNumAngles);
  for (int degrees = -60; degrees <= 60; degrees += 10) {
    const double angle = degrees * kDegree, to_s = kHeadRadiusM / kHeadSpeedOfSoundMPerS;
    const double left_s = to_s * (1 + rigid_sphere_delay(std::abs(0.5 * std::numbers::pi - angle)));
    const double right_s = to_s * (1 + rigid_sphere_delay(std::abs(0.5 * std::numbers::pi + angle)));
    const auto estimate = ears.estimate(delayed_noise(left_s, right_s, 2400), response);
    ASSERT_FALSE(estimate.silent);
    EXPECT_NEAR(estimate.lateral_rad / kDegree, degrees, 10.0);
    EXPECT_GT(estimate.coherence, 0.9);
  }
}

TEST(InterauralBearing, EarsThatHearDifferentNoiseAgreeOnNothing) {
  InterauralBearing ears(kRate_hz);
  std::vector<float> response(InterauralBearing::kNumAngles);
  std::vector<float> sound = delayed_noise(0, 0, 2400);
  const double together = ears.estimate(sound, response).agreement;
  const RandomStream random(4, Purpose::test);
  for (std::size_t i = 2400; i < 4800; ++i) sound[i] = random.normal2(static_cast<std::uint32_t>(i))[0];
  EXPECT_LT(ears.estimate(sound, response).agreement, 0.5 * together);
}

TEST(InterauralBearing, SilenceSaysNothing) {
  InterauralBearing ears(kRate_hz);
  std::vector<float> response(InterauralBearing::kNumAngles, 1.f);
  EXPECT_TRUE(ears.estimate(std::vector<float>(4800, 0.f), response).silent);
  for (const float r : response) EXPECT_EQ(r, 0.f);
}

}  // namespace
}  // namespace earshot
