// SPDX-License-Identifier: Apache-2.0
#include "sim/acoustics/synthesis/late_carriers.h"

#include <gtest/gtest.h>

#include <array>
#include <cmath>
#include <numbers>

#include "sim/base/random.h"
#include "tests/support/acoustics/synthesis_cases.h"

namespace earshot {
namespace {

using namespace synthesis_cases;

double correlation(std::span<const float> a, std::span<const float> b) {
  double product = 0;
  for (std::size_t n = 0; n < a.size(); ++n) product += static_cast<double>(a[n]) * static_cast<double>(b[n]);
  return product / std::sqrt(energy_of(a) * energy_of(b));
}

/// A synthesizer as a preset has it, of a second at 16 kHz, and a decay of one second.
struct Listening {
  Listening(const char* preset, ChannelLayout layout)
      : synthesizer([&] {
          AcousticConfig config = acoustic_preset(preset);
          config.sample_rate_hz = 16000.f;
          config.rir_length_s = 1.f;
          return make_synthesis_tables(config, BandLayout::octaves(16000.f), layout, nullptr);
        }()) {
    response.late = decay_of(1.0, 0.02, 7, 0.004f, 1.0);
  }
  Rir at(std::uint64_t source, glm::vec3 listener) {
    Rir rir;
    synthesizer.render(response, 0.4, {source, listener}, rir);
    return rir;
  }
  RirSynthesizer synthesizer;
  EnergyResponse response = response_with();
};

/// What a response repeats of itself.
class Autocorrelation {
 public:
  explicit Autocorrelation(int size)
      : fft_(size), spectrum_(static_cast<std::size_t>(fft_.num_bins())), correlations_(static_cast<std::size_t>(fft_.size())) {}
  /// The largest magnitude over lags [first, end), over that at lag 0.
  float highest(std::span<const float> samples, std::size_t first, std::size_t end) {
    fft_.forward(samples, spectrum_);
    for (std::complex<float>& bin : spectrum_) bin = std::norm(bin);
    fft_.inverse(spectrum_, correlations_);
    float highest = 0;
    for (std::size_t lag = first; lag < end; ++lag) highest = std::max(highest, std::abs(correlations_[lag] / correlations_[0]));
    return highest;
  }

 private:
  RealFft fft_;
  std::vector<std::complex<float>> spectrum_;
  std::vector<float> correlations_;
};

glm::vec3 some_place(std::uint32_t number) {
  const auto u = RandomStream(3, Purpose::test, number).uniform4(0);
  return {20.f * u[0] - 10.f, 1.f + u[1], 20.f * u[2] - 10.f};
}
glm::vec3 level_direction(std::uint32_t number) {
  const float angle = 6.2831853f * RandomStream(4, Purpose::test, number).uniform(0);
  return {std::cos(angle), 0.f, std::sin(angle)};
}

constexpr std::array<const char*, 2> kPresets = {"fast", "balanced"};
constexpr std::array<ChannelLayout, 2> kLayouts = {ChannelLayout::mono, ChannelLayout::binaural};

// Chance alone gives 1 / sqrt(8000 Hz * 0.145 s) = 0.03, an ear, whose low octaves are louder, 0.04; one noise for both 0.99, and 6 dB.
TEST(LateCarriers, TailsOfTwoSourcesAreIndependent) {
  for (const char* preset : kPresets) {
    for (const ChannelLayout layout : kLayouts) {
      Listening listening(preset, layout);
      double alone = 0, together = 0;
      constexpr std::uint32_t pairs = 8;
      for (std::uint32_t i = 0; i < pairs; ++i) {
        const Rir a = listening.at(10 + 2 * i, some_place(i)), b = listening.at(11 + 2 * i, some_place(i));
        for (int channel = 0; channel < a.num_channels; ++channel)
          EXPECT_LT(std::abs(correlation(a.channel(channel), b.channel(channel))), 0.1) << preset << ' ' << i;
        alone += 0.5 * (energy_of(a.samples) + energy_of(b.samples));
        for (std::size_t n = 0; n < a.samples.size(); ++n) together += std::pow(static_cast<double>(a.samples[n] + b.samples[n]), 2);
      }
      EXPECT_NEAR(db(together / alone), 3.01, 0.3) << preset;
    }
  }
}

TEST(LateCarriers, PlacesFarApartAreIndependent) {
  for (const char* preset : kPresets) {
    for (const ChannelLayout layout : kLayouts) {
      Listening listening(preset, layout);
      for (std::uint32_t i = 0; i < 12; ++i) {
        const glm::vec3 place = some_place(100 + i);
        const Rir a = listening.at(5, place), b = listening.at(5, place + 2.8f * level_direction(i));
        for (int channel = 0; channel < a.num_channels; ++channel)
          EXPECT_LT(std::abs(correlation(a.channel(channel), b.channel(channel))), 0.2) << preset << ' ' << i;
      }
    }
  }
}

// The mean over sources and directions against sin(k d) / (k d) at 125 and 250 Hz (Cook et al. 1955).  Tolerance 0.15: one lattice serves
// all bands.  At 500 Hz and 0.2 m a diffuse field has 0.53, and this noise 0.82.
TEST(LateCarriers, NearPlacesHaveAboutTheCoherenceOfADiffuseField) {
  Listening listening("fast", ChannelLayout::mono);
  constexpr std::uint32_t pairs = 200;
  for (const double distance_m : {0.01, 0.05, 0.2}) {
    double mean = 0;
    for (std::uint32_t i = 0; i < pairs; ++i) {
      const glm::vec3 place = some_place(200 + i);
      mean += correlation(listening.at(1000 + i, place).samples,
                          listening.at(1000 + i, place + static_cast<float>(distance_m) * level_direction(50 + i)).samples) /
              pairs;
    }
    for (const double frequency_hz : {125.0, 250.0}) {
      const double kd = 2.0 * std::numbers::pi * frequency_hz / 343.0 * distance_m;
      EXPECT_NEAR(mean, std::sin(kd) / kd, 0.15) << distance_m << " m, " << frequency_hz << " Hz";
    }
  }
}

// Steps of a centimetre across several cells: a zone of 0.28 m is passed in 28 of them, and two axes may change at once.
TEST(LateCarriers, NothingJumpsAlongAWalk) {
  Listening listening("fast", ChannelLayout::binaural);
  const glm::vec3 start = some_place(7), along = 0.01f * level_direction(7);
  Rir before = listening.at(9, start);
  double lowest = 1;
  for (int step = 1; step <= 400; ++step) {
    Rir now = listening.at(9, start + static_cast<float>(step) * along);
    lowest = std::min(lowest, correlation(now.channel(0), before.channel(0)));
    before = std::move(now);
  }
  EXPECT_GT(lowest, 0.9);
  EXPECT_LT(correlation(before.channel(0), listening.at(9, start).channel(0)), 0.2);
}

// Cells and borders alike have the energy that was put in, and the same place the same bits.
TEST(LateCarriers, EveryPlaceHasTheEnergyOfTheField) {
  Listening listening("fast", ChannelLayout::mono), other("fast", ChannelLayout::mono);
  const double put_in = 0.02 * (1.0 - 1e-6);
  double mean = 0;
  constexpr std::uint32_t places = 100;
  for (std::uint32_t i = 0; i < places; ++i) {
    const Rir rir = listening.at(3, some_place(400 + i));
    EXPECT_NEAR(db(energy_of(rir.samples) / put_in), 0.0, 0.6) << i;
    mean += energy_of(rir.samples) / places;
    if (i % 10 == 0) {
      EXPECT_EQ(other.at(3, some_place(400 + i)).samples, rir.samples);
    }
  }
  EXPECT_NEAR(db(mean / put_in), 0.0, 0.1);
}

// A source that moves under one key: independent beyond a cell, the same within a step.
TEST(LateCarriers, AMovingSourceTakesItsNoiseAlongSlowly) {
  Listening listening("fast", ChannelLayout::mono);
  const auto with_source = [&](glm::vec3 source) {
    Rir rir;
    listening.synthesizer.render(listening.response, 0.0, {3, glm::vec3(1, 1.5f, 2), source}, rir);
    return rir;
  };
  double near = 0;
  for (std::uint32_t i = 0; i < 20; ++i) {
    const glm::vec3 place = some_place(600 + i);
    const Rir here = with_source(place);
    near += correlation(here.samples, with_source(place + 0.01f * level_direction(i)).samples) / 20;
    EXPECT_LT(std::abs(correlation(here.samples, with_source(place + 2.8f * level_direction(i)).samples)), 0.2);
  }
  EXPECT_GT(near, 0.97);
}

// A steady response of 4 s at 16 kHz, the longest that the loops hold, repeats nothing: its autocorrelation from 50 ms to 2 s stays below
// five times chance, 1 / sqrt(64000) = 0.004, in cells and between them.  A quarter that came twice would stand out with 0.25.
TEST(LateCarriers, ALongResponseHoldsNoRepeat) {
  RirSynthesizer synthesizer(
      make_synthesis_tables(config_at(16000.f, 4.f), BandLayout::log_spaced(3, 16000.f), ChannelLayout::mono, nullptr));
  EnergyResponse response = response_with();
  response.late = decay_of(1e6, 1e5, 3, 0.004f, 4.0);
  Autocorrelation autocorrelation(1 << 17);
  for (std::uint32_t i = 0; i < 10; ++i) {
    Rir rir;
    synthesizer.render(response, 0.0, {11, some_place(700 + i)}, rir);
    const float highest = autocorrelation.highest(rir.samples, 800, 32000);
    EXPECT_LT(highest, 0.02f) << i;
  }
}

// Nor do ears hear a repeat where the decoded beginning passes into the binaural tail: a steady second, of which the first 0.16 s are
// decoded. Chance gives the ear 0.012; if the tail read again what the beginning had read, 0.16 would stand out.
TEST(LateCarriers, TheBinauralTailDoesNotRepeatItsBeginning) {
  Listening listening("fast", ChannelLayout::binaural);
  listening.response.late = decay_of(1e6, 1e5, 7, 0.004f, 1.0);
  Autocorrelation autocorrelation(1 << 15);
  for (std::uint32_t i = 0; i < 24; ++i) {
    const Rir rir = listening.at(20 + i, some_place(800 + i));
    for (int ear = 0; ear < 2; ++ear) {
      const float highest = autocorrelation.highest(rir.channel(ear), 800, 15000);
      EXPECT_LT(highest, 0.06f) << i;
    }
  }
}

// Two faces at once, one of the listener's cells and one of a moving source's: four cells share the response, and none repeats another.
TEST(LateCarriers, AMovingSourceHearsNoRepeatEither) {
  Listening listening("fast", ChannelLayout::mono);
  listening.response.late = decay_of(1e6, 1e5, 7, 0.004f, 1.0);
  Autocorrelation autocorrelation(1 << 15);
  int high = 0;
  for (std::uint32_t i = 0; i < 100; ++i) {
    Rir rir;
    listening.synthesizer.render(listening.response, 0.0, {3, some_place(900 + i), some_place(1100 + i)}, rir);
    const float highest = autocorrelation.highest(rir.samples, 800, 15000);
    high += highest > 0.06f ? 1 : 0;
  }
  // Three zones of six at once, where the header promises less, meet in 6 % of poses, and in a part of them only cells repeat.
  EXPECT_LE(high, 3);
}

}  // namespace
}  // namespace earshot
