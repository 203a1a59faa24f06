// SPDX-License-Identifier: Apache-2.0
#include "sim/acoustics/synthesis/binaural_late_tail.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <memory>

#include "sim/acoustics/synthesis/rir_synthesis.h"
#include "tests/support/acoustics/synthesis_cases.h"

namespace earshot {
namespace {

using namespace synthesis_cases;

std::shared_ptr<const SynthesisTables> tables_with(float late_decode_s) {
  AcousticConfig config = config_at(16000.f);
  config.late_decode_s = late_decode_s;
  return make_synthesis_tables(config, BandLayout::octaves(16000.f), ChannelLayout::binaural, Hrtf::rigid_sphere(16000.f));
}
/// The whole late field through the decoder, or none of it.
const std::shared_ptr<const SynthesisTables>& decoded_tables() {
  static const auto tables = tables_with(60.f);
  return tables;
}
const std::shared_ptr<const SynthesisTables>& mixed_tables() {
  static const auto tables = tables_with(0.f);
  return tables;
}

/// Energy at both ears and their product over many segments of noise.
struct EarCovariance {
  double left = 0, right = 0, cross = 0;
  [[nodiscard]] double correlation() const { return cross / std::sqrt(left * right); }
};
EarCovariance covariance_of(const std::shared_ptr<const SynthesisTables>& tables, const EnergyHistogram& late,
                            const ListenerOrientation& orientation) {
  RirSynthesizer synthesizer(tables);
  EnergyResponse response = response_with();
  response.late = late;
  EarCovariance sum;
  Rir rir;
  for (std::uint64_t key = 0; key < 24; ++key) {
    synthesizer.render(response, orientation, key, rir);
    const auto left = rir.channel(0), right = rir.channel(1);
    sum.left += energy_of(left);
    sum.right += energy_of(right);
    for (std::size_t n = 0; n < left.size(); ++n) sum.cross += static_cast<double>(left[n]) * static_cast<double>(right[n]);
  }
  return sum;
}

// A field of any direction, in one band at a time, gives each ear the power, and both the correlation, that it has through the decoder.
// The segments cover a loop of one second, in which flattened noise has its power within 0.1 dB, and products of it within 0.015 of their
// mean.  A factor of two is 3 dB.
TEST(BinauralLateTail, PowersAndCorrelationAreThoseOfTheDecoder) {
  struct Case {
    glm::vec3 from;
    float directivity;
    ListenerOrientation orientation;
  };
  const Case cases[] = {{{0, 0, -1}, 0.f, ListenerOrientation(0.7)},         {{1, 0, 0}, 0.5f, ListenerOrientation(0.0)},
                        {{1, 0, 0}, 1.f, ListenerOrientation(0.6)},          {{0, 0, -1}, 1.f, ListenerOrientation(0.0)},
                        {{0, 1, 0}, 0.8f, ListenerOrientation(0, 0.4, 0.7)}, {{-0.6f, 0, 0.8f}, 0.7f, ListenerOrientation(-2.0)}};
  constexpr int num_bands = 7;
  for (const Case& c : cases) {
    for (int band = 0; band < num_bands; ++band) {
      EnergyHistogram late = decay_of(3.0, 0.02, num_bands, 0.004f, 0.5, 1, c.from, c.directivity);
      for (std::size_t i = 0; i < late.values().size(); ++i)
        if (static_cast<int>(i / 4) % num_bands != band) late.values()[i] = 0;
      const EarCovariance decoded = covariance_of(decoded_tables(), late, c.orientation),
                          mixed = covariance_of(mixed_tables(), late, c.orientation);
      EXPECT_NEAR(db(mixed.left / decoded.left), 0.0, 0.2) << c.directivity << ", band " << band;
      EXPECT_NEAR(db(mixed.right / decoded.right), 0.0, 0.2) << c.directivity << ", band " << band;
      EXPECT_NEAR(mixed.correlation(), decoded.correlation(), 0.03) << c.directivity << ", band " << band;
    }
  }
}

// Up to the bin where decoding ends nothing differs; from there to the next bin, 4 ms, the one falls in power as the other grows, so that
// the level of a steady field has neither a dip nor a bump: 64 samples of two ears and 64 keys, 0.15 dB.  Fades in amplitude would leave
// -1.8 dB, one fade alone 3 dB.
TEST(BinauralLateTail, TakesOverWithoutAStep) {
  constexpr float decode_s = 0.1f;
  constexpr int keys = 64, onset = 320, block = 320;
  const auto tables = tables_with(decode_s);
  RirSynthesizer synthesizer(tables), decoding(decoded_tables());
  EnergyResponse response = response_with({arrival_at(onset / 16000.0 * 343.0, 0.0)});
  response.late = decay_of(1e6, 1e5, 7, 0.004f, 0.5, 1, {1, 0, 0}, 0.14f);  // not so directional that the end is decoded
  std::array<double, 8000 / block> level{}, decoded_level{};
  double worst = 0, fading = 0, decoded_fading = 0;
  for (std::uint64_t key = 0; key < keys; ++key) {
    const Rir rir = rendered(synthesizer, response, 0.3, key), decoded = rendered(decoding, response, 0.3, key);
    const double peak = static_cast<double>(*std::ranges::max_element(decoded.samples));
    for (int ear = 0; ear < 2; ++ear)
      for (int n = 0; n < 8000; ++n) {
        // The bin of 4 ms before 0.12 s, less the 2 ms by which the decoder rings ahead.
        if (n < onset + 1600 - 64 - 32)
          worst = std::max(worst, std::abs(static_cast<double>(rir.channel(ear)[n] - decoded.channel(ear)[n])) / peak);
        const double power = static_cast<double>(rir.channel(ear)[n]) * static_cast<double>(rir.channel(ear)[n]);
        const double decoded_power = static_cast<double>(decoded.channel(ear)[n]) * static_cast<double>(decoded.channel(ear)[n]);
        level[static_cast<std::size_t>(n / block)] += power;
        decoded_level[static_cast<std::size_t>(n / block)] += decoded_power;
        if (n >= onset + 1600 - 32 && n < onset + 1600 + 32) fading += power, decoded_fading += decoded_power;
      }
  }
  EXPECT_LT(worst, 1e-5);
  EXPECT_NEAR(db(fading / decoded_fading), 0.0, 0.5);
  for (std::size_t i = 2; i + 1 < level.size(); ++i) EXPECT_NEAR(db(level[i] / decoded_level[i]), 0.0, 0.3) << i;
  EXPECT_NE(level.back(), decoded_level.back());
}

// Without a direct sound the late sound itself says where it begins: the same waveform for so long, however far the source.
TEST(BinauralLateTail, DecodingCountsFromTheFirstSound) {
  const auto tables = tables_with(0.1f);
  RirSynthesizer synthesizer(tables), decoding(decoded_tables());
  EnergyResponse response = response_with();
  response.late = decay_of(1.0, 1.0, 7);
  constexpr int first_bin = 50;  // 0.2 s
  std::fill_n(response.late.values().begin(), first_bin * 7 * 4, 0.f);
  const Rir rir = rendered(synthesizer, response, 0.3, 3), decoded = rendered(decoding, response, 0.3, 3);
  const double peak = static_cast<double>(*std::ranges::max_element(decoded.samples));
  // Its bin of 256 samples begins at 3072.  The fade may begin up to a bin before 0.1 s are over, less the 2 ms of the decoder.
  for (int n = 0; n < 3072 + 1600 - 256 - 32; ++n) ASSERT_NEAR(rir.channel(0)[n], decoded.channel(0)[n], 1e-5 * peak) << n;
  double apart = 0;
  for (int n = 5200; n < 8000; ++n) apart = std::max(apart, std::abs(static_cast<double>(rir.channel(0)[n] - decoded.channel(0)[n])));
  EXPECT_GT(apart, 1e-2 * peak);
}

/// Largest normalized cross-correlation of the ears within 1 ms over many keys, from 0.2 s on, and its lag in samples.
struct Iacc {
  double value = 0;
  int lag = 0;
};
Iacc late_iacc(const std::shared_ptr<const SynthesisTables>& tables, const EnergyHistogram& late) {
  RirSynthesizer synthesizer(tables);
  EnergyResponse response = response_with();
  response.late = late;
  std::array<double, 33> cross{};
  double left = 0, right = 0;
  for (std::uint64_t key = 0; key < 48; ++key) {
    const Rir rir = rendered(synthesizer, response, 0.0, key);
    for (int n = 3200; n < 7900; ++n) {
      const auto l = static_cast<double>(rir.channel(0)[n]), r = static_cast<double>(rir.channel(1)[n]);
      left += l * l, right += r * r;
      for (int lag = -16; lag <= 16; ++lag) cross[static_cast<std::size_t>(lag + 16)] += l * static_cast<double>(rir.channel(1)[n + lag]);
    }
  }
  Iacc result;
  for (int lag = -16; lag <= 16; ++lag) {
    const double value = std::abs(cross[static_cast<std::size_t>(lag + 16)]) / std::sqrt(left * right);
    if (value > result.value) result = {value, lag};
  }
  return result;
}

// Beside a door the tail comes from one side for long, and the time between the ears is that of this side.  What is more directional than
// the bound is decoded: IACC within 0.02 and a sample.  Below it the loss stays under the just noticeable difference of 0.075 (ISO 3382-1).
TEST(BinauralLateTail, LosesLittleOfTheDirectionOfATail) {
  const auto tables = tables_with(0.16f);
  for (const float directivity : {0.f, 0.1f, 0.19f, 0.25f, 0.5f, 0.8f}) {
    const EnergyHistogram late = decay_of(0.8, 0.02, 7, 0.004f, 0.5, 1, {0.8f, 0, -0.6f}, directivity);
    const Iacc decoded = late_iacc(decoded_tables(), late), fast = late_iacc(tables, late);
    EXPECT_NEAR(fast.value, decoded.value, directivity > 0.2f ? 0.02 : 0.075) << directivity << ": " << fast.lag << ' ' << decoded.lag;
    if (directivity > 0.2f) {
      EXPECT_NEAR(fast.lag, decoded.lag, 1) << directivity;
    }
  }
}

// A pose that moves changes the direction of a tail little by little, and what is decoded of it too: from one step of 0.004 to the next the
// sound from 0.16 s on changes by what one merged bin holds, of 16 ms at most, so that with independent noise there the correlation is
// above exp(-13.8 * 0.016 / 0.8) = 0.76 where the bins are even; a switch gives 0.
TEST(BinauralLateTail, DecodingDoesNotEndSuddenlyWithTheDirection) {
  RirSynthesizer synthesizer(tables_with(0.16f));
  EnergyResponse response = response_with();
  std::vector<float> before;
  double lowest = 1, to_first = 1;
  std::vector<float> first;
  for (int step = 0; step <= 50; ++step) {
    response.late = decay_of(0.8, 0.02, 7, 0.004f, 0.5, 1, {0.8f, 0, -0.6f}, 0.1f + 0.004f * static_cast<float>(step));
    const Rir rir = rendered(synthesizer, response);
    const std::vector<float> now(rir.channel(0).begin() + 2600, rir.channel(0).end());
    const auto correlation = [&](const std::vector<float>& other) {
      double product = 0;
      for (std::size_t n = 0; n < now.size(); ++n) product += static_cast<double>(now[n]) * static_cast<double>(other[n]);
      return product / std::sqrt(energy_of(now) * energy_of(other));
    };
    if (step == 0)
      first = now;
    else
      lowest = std::min(lowest, correlation(before)), to_first = correlation(first);
    before = now;
  }
  EXPECT_GT(lowest, 0.7);
  EXPECT_LT(to_first, 0.5);  // at the end all is decoded
}

// Bins of very different energy, and silent ones between: none of it is lost but what lines in amplitude take from lines in power.
// A bin alone keeps all.
TEST(BinauralLateTail, UnevenBinsKeepTheirEnergy) {
  RirSynthesizer synthesizer(mixed_tables()), decoding(decoded_tables());
  EnergyResponse response = response_with();
  for (const bool alone : {true, false}) {
    response.late = EnergyHistogram(125, 7, 1, 0.004f);
    for (int bin = 44; bin < 120; ++bin) {
      const int merged = bin / 4;
      const float energy = alone ? (merged % 5 == 1 ? 1.f : 0.f) : (merged % 2 == 0 ? 1.f : 0.5f);
      for (int band = 0; band < 7; ++band) response.late.values()[static_cast<std::size_t>((bin * 7 + band) * 4)] = energy;
    }
    double mixed = 0, decoded = 0;
    for (std::uint64_t key = 0; key < 24; ++key) {
      mixed += energy_of(rendered(synthesizer, response, 0.3, key).samples);
      decoded += energy_of(rendered(decoding, response, 0.3, key).samples);
    }
    // (1 - sqrt 1/2)^2 / 6 of a mean of 3/4: 0.08 dB.
    EXPECT_NEAR(db(mixed / decoded), alone ? 0.0 : -0.08, 0.1) << alone;
  }
}

TEST(BinauralLateTail, TimesOutsideTheirRangeAreRefused) {
  for (const float late_decode_s : {-0.01f, 60.1f, std::numeric_limits<float>::quiet_NaN()})
    EXPECT_THROW(tables_with(late_decode_s), InputError) << late_decode_s;
}

}  // namespace
}  // namespace earshot
