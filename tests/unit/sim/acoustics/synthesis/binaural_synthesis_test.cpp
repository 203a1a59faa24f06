// SPDX-License-Identifier: Apache-2.0
#include <gtest/gtest.h>

#include <array>
#include <numbers>

#include "sim/acoustics/synthesis/rir_synthesis.h"
#include "tests/support/acoustics/synthesis_cases.h"

namespace earshot {
namespace {

using namespace synthesis_cases;

TEST(BinauralSynthesis, DirectSoundHasTheCuesOfItsDirection) {
  RirSynthesizer synthesizer(binaural_tables());
  const Rir right = rendered(synthesizer, response_with({arrival_at(5.0, 1.0, {1, 0, 0})}));
  const Rir left = rendered(synthesizer, response_with({arrival_at(5.0, 1.0, {-1, 0, 0})}));
  ASSERT_EQ(right.num_channels, 2);
  EXPECT_GT(energy_of(right.channel(1)), 2.0 * energy_of(right.channel(0)));
  for (int n = 0; n < right.num_samples; ++n) {
    ASSERT_EQ(right.channel(0)[n], left.channel(1)[n]);
    ASSERT_EQ(right.channel(1)[n], left.channel(0)[n]);
  }
  // Low frequencies arrive when the wave passes the centre of the head, half of 753.7 us early at the right ear and as late at the left
  // (O-27, ears at +-100).
  const auto at_right = spectrum_of(right.channel(1)), at_left = spectrum_of(right.channel(0));
  const double size = 2.0 * static_cast<double>(at_right.size() - 1), frequency_hz = 200.0;
  const auto k = static_cast<std::size_t>(std::lround(frequency_hz / 16000.0 * size));
  const double turn = std::remainder(
      std::arg(at_right[k]) + std::arg(at_left[k]) + 2.0 * 2.0 * std::numbers::pi * static_cast<double>(k) / size * (5.0 / 343.0 * 16000.0),
      2.0 * std::numbers::pi);
  EXPECT_NEAR(turn / 2.0, 0.0, 0.02);  // of a turn of 2 pi per 5 ms: 16 us
  EXPECT_NEAR(std::arg(at_right[k] * std::conj(at_left[k])) / (2.0 * std::numbers::pi * static_cast<double>(k) * 16000.0 / size) * 1e6,
              766.4, 15.0);
  const Rir front = rendered(synthesizer, response_with({arrival_at(5.0, 1.0, {0, 0, -1})}));
  for (int n = 0; n < front.num_samples; ++n) ASSERT_EQ(front.channel(0)[n], front.channel(1)[n]);
}

TEST(BinauralSynthesis, DirectSoundAtLowFrequenciesHasItsAmplitude) {
  RirSynthesizer synthesizer(binaural_tables());
  const Rir rir = rendered(synthesizer, response_with({arrival_at(20.0, 0.25, {0.6f, 0, -0.8f})}));
  for (int ear = 0; ear < 2; ++ear)
    EXPECT_NEAR(std::abs(spectrum_of(rir.channel(ear))[10]) / 0.25, 1.0, 0.02);  // 10 Hz: the head is not there
}

TEST(BinauralSynthesis, TurningTheHeadTurnsTheWorld) {
  RirSynthesizer synthesizer(binaural_tables());
  const auto world = [](double azimuth_deg) {  // counter-clockwise from the front
    const double a = azimuth_deg * kDegree;
    return glm::vec3(-std::sin(a), 0, -std::cos(a));
  };
  for (const double heading_deg : {0.0, 30.0, 90.0, -130.0}) {
    EnergyResponse turned = response_with({arrival_at(5.0, 1.0, world(40.0 + heading_deg))});
    EnergyResponse straight = response_with({arrival_at(5.0, 1.0, world(40.0))});
    const Rir a = rendered(synthesizer, turned, heading_deg * kDegree), b = rendered(synthesizer, straight, 0.0);
    for (std::size_t n = 0; n < a.samples.size(); ++n) ASSERT_NEAR(a.samples[n], b.samples[n], 2e-5) << heading_deg;  // float direction
  }
}

struct LateTail {
  double left = 0, right = 0, coherence_500 = 0, coherence_1000 = 0, coherence_250 = 0;
};

/// Levels and coherence of the late field over many keys.
LateTail late_tail(const EnergyHistogram& late, double heading_rad) {
  RirSynthesizer synthesizer(binaural_tables());
  EnergyResponse response = response_with();
  response.late = late;
  LateTail result;
  std::array<std::complex<double>, 3> cross{};
  std::array<double, 3> left{}, right{};
  const double centre_hz[3] = {250, 500, 1000};
  constexpr int keys = 24;
  for (std::uint64_t key = 0; key < keys; ++key) {
    const Rir rir = rendered(synthesizer, response, heading_rad, key);
    result.left += energy_of(rir.channel(0)) / keys;
    result.right += energy_of(rir.channel(1)) / keys;
    const auto l = spectrum_of(rir.channel(0)), r = spectrum_of(rir.channel(1));
    const double size = 2.0 * static_cast<double>(l.size() - 1);
    for (std::size_t f = 0; f < 3; ++f) {
      for (auto k = static_cast<std::size_t>(centre_hz[f] * 0.95 / 16000.0 * size);
           static_cast<double>(k) < centre_hz[f] * 1.05 / 16000.0 * size; ++k) {
        cross[f] += std::complex<double>(r[k]) * std::conj(std::complex<double>(l[k]));
        left[f] += std::norm(l[k]);
        right[f] += std::norm(r[k]);
      }
    }
  }
  const auto coherence = [&](std::size_t f) { return cross[f].real() / std::sqrt(left[f] * right[f]); };
  result.coherence_250 = coherence(0), result.coherence_500 = coherence(1), result.coherence_1000 = coherence(2);
  return result;
}

// docs/explanation/estimators.md, section 6: pressure noise times spherical harmonics gives 1.0 here.
TEST(BinauralSynthesis, DiffuseTailHasTheCoherenceOfAHead) {
  const LateTail ears = late_tail(decay_of(2.0, 0.02, 7), 0.7);
  EXPECT_NEAR(ears.coherence_250, 0.7636, 0.1);
  EXPECT_NEAR(ears.coherence_500, 0.2037, 0.1);
  EXPECT_NEAR(ears.coherence_1000, -0.1251, 0.1);
  EXPECT_NEAR(db(ears.left / ears.right), 0.0, 0.2);
}

// Power at an ear in a diffuse field over that of the centre without the head: from O-27's sphere, about +2 dB above 2 kHz, 0 dB at low
// frequencies.
TEST(BinauralSynthesis, DiffuseTailHasTheLevelOfAHead) {
  const double put_in = 0.02 * (1.0 - std::exp(-6.0 * std::log(10.0) * 0.5 / 2.0));
  double expected = 0;  // mean over frequency of the decoder's diffuse power, itself tested against the exact series in hrtf_test
  const auto head = Hrtf::rigid_sphere(16000.f);
  const auto bins = static_cast<std::size_t>(head->fft_size() / 2 + 1);
  for (std::size_t k = 0; k < bins; ++k)
    for (int c = 0; c < 4; ++c) expected += std::norm(head->diffuse_decoder(c, 0)[k]) / static_cast<double>(bins);
  const LateTail ears = late_tail(decay_of(2.0, 0.02, 7), 0.0);
  EXPECT_NEAR(db(ears.left / (put_in * expected)), 0.0, 0.2);
  EXPECT_NEAR(db(ears.right / (put_in * expected)), 0.0, 0.2);
}

TEST(BinauralSynthesis, DirectionalTailIsLouderOnItsSideAndTurnsWithTheHead) {
  const EnergyHistogram from_right = decay_of(2.0, 0.02, 7, 0.004f, 0.5, 1, {1, 0, 0}, 0.9f);
  const LateTail facing = late_tail(from_right, 0.0), turned_right = late_tail(from_right, -90 * kDegree),
                 turned_back = late_tail(from_right, 180 * kDegree);
  EXPECT_GT(db(facing.right / facing.left), 4.0);
  EXPECT_NEAR(db(turned_right.right / turned_right.left), 0.0, 0.5);  // now in front
  EXPECT_NEAR(db(turned_back.left / turned_back.right), db(facing.right / facing.left), 0.5);
  // A plane wave from the front is coherent at the ears.
  EXPECT_GT(late_tail(decay_of(2.0, 0.02, 7, 0.004f, 0.5, 1, {0, 0, -1}, 1.f), 0.0).coherence_500, 0.98);
}

// Ears mix four carriers.  For these short decays plain noise gives 15 % rms; flattening is bounded by the few degrees of freedom at 125
// Hz.  synthesis_decay_slow_test has the whole set of docs/explanation/estimators.md, section 6.
TEST(BinauralSynthesis, DecayTimeAtTheEarsIsThatOfTheEnergy) {
  RirSynthesizer synthesizer(binaural_tables());
  double sum = 0;
  int count = 0;
  for (const double decay_s : {0.2, 0.3, 0.4}) {
    EnergyResponse response = response_with();
    response.late = decay_of(decay_s, 0.02, 7);
    for (const std::uint64_t key : {1ull, 2ull, 3ull, 4ull}) {
      const Rir rir = rendered(synthesizer, response, 0.9 * static_cast<double>(key), key);
      for (int ear = 0; ear < 2; ++ear) {
        for (const double centre_hz : {125.0, 250.0, 500.0, 1000.0, 2000.0, 4000.0}) {
          const double error = t20_s(octave_band(rir.channel(ear), centre_hz, 16000.0), 16000.0) / decay_s - 1.0;
          sum += error * error;
          ++count;
        }
      }
    }
  }
  EXPECT_LT(std::sqrt(sum / count), 0.03);
}

}  // namespace
}  // namespace earshot
