// SPDX-License-Identifier: Apache-2.0
#include "sim/acoustics/synthesis/rir_synthesis.h"

#include <gtest/gtest.h>

#include <array>
#include <map>
#include <numbers>

#include "sim/base/errors.h"
#include "tests/support/acoustics/synthesis_cases.h"

namespace earshot {
namespace {

using namespace synthesis_cases;

TEST(RirSynthesis, DirectSoundAtAWholeSampleIsOneSampleO1) {  // docs/evidence/oracles.md, O-1: 3.43 m, 10 ms, 0.02320043
  for (const auto& [rate, sample] : {std::pair{16000.f, 160}, {44100.f, 441}, {48000.f, 480}}) {
    const Rir rir = rendered(mono_at(rate, 0.1f), response_with({arrival_at(3.43, 0.02320043)}));
    ASSERT_EQ(rir.num_channels, 1);
    ASSERT_EQ(rir.num_samples, static_cast<int>(std::lround(0.1 * static_cast<double>(rate))));
    for (int n = 0; n < rir.num_samples; ++n) ASSERT_EQ(rir.samples[n], n == sample ? 0.02320043f : 0.f) << rate << ' ' << n;
  }
}

TEST(RirSynthesis, DelayIsExactToAThousandthOfASampleO1) {
  for (const float rate : {8000.f, 16000.f, 44100.f}) {
    RirSynthesizer synthesizer = mono_at(rate, 0.1f);
    for (const double distance_m : {1.0, 2.0, 2.005, 5.0, 7.77}) {
      const Rir rir = rendered(synthesizer, response_with({arrival_at(distance_m, 1.0)}));
      EXPECT_NEAR(phase_delay(rir.samples, 0.05, 0.9), distance_m / 343.0 * static_cast<double>(rate), 1e-3) << rate << ' ' << distance_m;
    }
  }
}

TEST(RirSynthesis, DirectEnergyIsTheSameAtAllRatesO1) {  // O-1, H-31
  for (const float rate : {8000.f, 11025.f, 16000.f, 44100.f, 48000.f, 96000.f}) {
    RirSynthesizer synthesizer = mono_at(rate, 0.05f);
    for (const double distance_m : {3.0, 5.0, 10.0}) {
      const double amplitude = 1.0 / (4.0 * std::numbers::pi * distance_m);
      const Rir rir = rendered(synthesizer, response_with({arrival_at(distance_m, amplitude)}));
      EXPECT_NEAR(db(energy_of(rir.samples) / (amplitude * amplitude)), 0.0, 0.05) << rate << ' ' << distance_m;
    }
  }
}

TEST(RirSynthesis, AmplitudeFallsAsOneOverDistance) {
  RirSynthesizer synthesizer = usual_mono();
  // DC gain of the response: sum of samples.
  for (const auto& [distance_m, expected] : {std::pair{0.5, 0.1591549}, {1.0, 0.07957747}, {5.0, 0.01591549}}) {
    const Rir rir = rendered(synthesizer, response_with({arrival_at(distance_m, 1.0 / (4.0 * std::numbers::pi * distance_m))}));
    double sum = 0;
    for (const float value : rir.samples) sum += static_cast<double>(value);
    EXPECT_NEAR(sum / expected, 1.0, 1e-2);  // what rings before time zero is cut
  }
}

TEST(RirSynthesis, BandGainsShapeTheSpectrum) {
  RirSynthesizer synthesizer = usual_mono();
  Arrival arrival = arrival_at(20.0, 0.0);
  const double gains[7] = {0.9, 0.1, 0.5, 0.3, 0.7, 0.2, 0.4};
  for (int band = 0; band < 7; ++band) arrival.amplitude[static_cast<std::size_t>(band)] = static_cast<float>(gains[band]);
  const Rir rir = rendered(synthesizer, response_with({arrival}));
  const auto spectrum = spectrum_of(rir.samples);
  const auto size = static_cast<double>(2 * (spectrum.size() - 1));
  for (int band = 0; band < 7; ++band) {
    const double centre_hz = 1000.0 * std::pow(10.0, 0.3 * (band - 3));
    const double size_at_centre = std::abs(spectrum[static_cast<std::size_t>(std::lround(centre_hz / 16000.0 * size))]);
    EXPECT_NEAR(size_at_centre, gains[band], band == 0 ? 0.1 : 0.03) << centre_hz;  // 31 Hz bins under the lowest octaves
  }
  EXPECT_NEAR(phase_delay(rir.samples, 0.01, 0.9), 20.0 / 343.0 * 16000.0, 2e-3);  // the filters have no phase
}

TEST(RirSynthesis, FlatResponseIsTheSameForAnyNumberOfBands) {  // H-29
  std::map<int, RirSynthesizer> synthesizers;
  const auto render_with = [&](int bands, std::uint64_t key) {
    EnergyResponse response = response_with({arrival_at(4.2, 0.1), arrival_at(7.3, 0.05, {0, 0, -1}, 1)});
    response.late = decay_of(0.4, 1e-2, BandLayout::log_spaced(bands, 16000.f).size());
    return rendered(synthesizers.try_emplace(bands, mono_at(16000.f, 0.5f, bands)).first->second, response, 0, key);
  };
  const double expected = 0.1 * 0.1 + 0.05 * 0.05 + 1e-2;
  // Each arrival falls on a sample of the noise, 0.0047 rms there: their product is 0.2 dB rms for one key, 0.025 dB over 64.
#ifdef EARSHOT_SANITIZED
  constexpr int num_keys = 4;  // every line is run by one; the numbers are judged without sanitizers
#else
  constexpr int num_keys = 64;
#endif
  const double four_errors_db = 4 * 0.2 / std::sqrt(num_keys);
  for (const int bands : {1, 2, 5, 8, 31}) {
    double energy = 0;
    for (std::uint64_t key = 0; key < num_keys; ++key) energy += energy_of(render_with(bands, key).samples) / num_keys;
    EXPECT_NEAR(db(energy / expected), 0.0, four_errors_db) << bands;
  }
}

TEST(RirSynthesis, ArrivalsOutsideTheResponseAreDropped) {  // H-11, H-32, H-33
  RirSynthesizer synthesizer = mono_at(16000.f, 0.05f);
  for (const double distance_m : {100.0, 1e6, 1e30}) {
    EnergyResponse response = response_with({arrival_at(distance_m, 1.0)});
    response.late = decay_of(0.5, 1.0, 7, 0.004f, 0.05);  // cannot precede the direct sound
    const Rir rir = rendered(synthesizer, response);
    ASSERT_EQ(rir.num_samples, 800);
    EXPECT_EQ(energy_of(rir.samples), 0.0) << distance_m;
  }
  const Rir last = rendered(synthesizer, response_with({arrival_at(799.0 / 16000.0 * 343.0, 1.0)}));
  EXPECT_NEAR(last.samples[799], 1.f, 1e-3);
  for (const double distance_m : {0.0, 0.01}) {
    const Rir rir = rendered(synthesizer, response_with({arrival_at(distance_m, 1.0, {0, 0, -1})}));
    EXPECT_GT(rir.samples[0], 0.5f);
    for (const float value : rir.samples) ASSERT_TRUE(std::isfinite(value));
  }
  const Rir shortest = rendered(mono_at(16000.f, 1.f / 16000.f), response_with({arrival_at(0.0, 0.5)}));
  EXPECT_EQ(shortest.samples, std::vector<float>{0.5f});
}

TEST(RirSynthesis, ArrivalsAtTheSameSampleAddUp) {  // H-74
  const Rir rir = rendered(usual_mono(), response_with({arrival_at(3.43, 0.5), arrival_at(3.43, 0.25, {1, 0, 0}, 1)}));
  EXPECT_EQ(rir.samples[160], 0.75f);
}

TEST(RirSynthesis, LateEnergyIsWhatWasPutIn) {  // docs/reference/conventions.md, section 2
  for (const float rate : {8000.f, 16000.f, 48000.f}) {
    RirSynthesizer synthesizer = mono_at(rate);
    const int bands = BandLayout::octaves(rate).size();
    for (const double decay_s : {0.15, 0.4, 1.2}) {
      EnergyResponse response = response_with();
      response.late = decay_of(decay_s, 0.02, bands);
      const double put_in = 0.02 * (1.0 - std::exp(-6.0 * std::log(10.0) * 0.5 / decay_s));
      double mean = 0;
      for (std::uint64_t key = 0; key < 8; ++key) {
        const double energy = energy_of(rendered(synthesizer, response, 0, key).samples);
        EXPECT_NEAR(db(energy / put_in), 0.0, 0.5) << rate << ' ' << decay_s;  // one render: 22 ms of noise in the shortest decay
        mean += energy / 8;
      }
      EXPECT_NEAR(db(mean / put_in), 0.0, 0.2) << rate << ' ' << decay_s;
    }
  }
}

// docs/explanation/estimators.md, section 6 (c).  One source alone scatters by 0.34 dB at 125 Hz, where an octave of this decay has few
// degrees of freedom, and by 0.2 dB and less above; the mean over 32 must be four times flatter than the oracle requires.
TEST(RirSynthesis, LateSpectrumIsFlat) {
  RirSynthesizer synthesizer = usual_mono();
  EnergyResponse response = response_with();
  response.late = decay_of(0.8, 0.02, 7);
  const double put_in = 0.02 * (1.0 - std::exp(-6.0 * std::log(10.0) * 0.5 / 0.8));
  std::array<double, 6> sum{}, count{};
  for (std::uint64_t key = 1; key <= 32; ++key) {
    const auto spectrum = spectrum_of(rendered(synthesizer, response, 0, key).samples);
    const auto size = static_cast<double>(2 * (spectrum.size() - 1));
    for (std::size_t band = 0; band < 6; ++band) {
      const double centre_hz = 1000.0 * std::pow(10.0, 0.3 * (static_cast<double>(band) - 3.0));
      double of_band = 0, bins = 0;
      for (auto k = static_cast<std::size_t>(centre_hz / 1.41 / 16000.0 * size); static_cast<double>(k) < centre_hz * 1.41 / 16000.0 * size;
           ++k, ++bins)
        of_band += std::norm(spectrum[k]);
      EXPECT_NEAR(db(of_band / bins / put_in), 0.0, band == 0 ? 1.4 : band == 1 ? 1.0 : 0.6) << centre_hz;  // four sigma
      sum[band] += of_band, count[band] += bins;
    }
  }
  for (std::size_t band = 0; band < 6; ++band) EXPECT_NEAR(db(sum[band] / count[band] / put_in), 0.0, band == 0 ? 0.25 : 0.125) << band;
}

TEST(RirSynthesis, BandEnergiesStayInTheirBands) {
  RirSynthesizer synthesizer = usual_mono();
  EnergyResponse response = response_with();
  response.late = decay_of(0.5, 0.0, 7);
  for (int bin = 0; bin < response.late.num_bins(); ++bin)
    response.late.values()[static_cast<std::size_t>((bin * 7 + 3) * 4)] = 1.f;  // 1 kHz only
  const Rir rir = rendered(synthesizer, response);
  const double inside = energy_of(octave_band(rir.samples, 1000.0, 16000.0));
  for (const double centre_hz : {125.0, 250.0, 4000.0})
    EXPECT_LT(db(energy_of(octave_band(rir.samples, centre_hz, 16000.0)) / inside), -40)
        << centre_hz;  // the sudden start of the tail splatters
}

// docs/explanation/estimators.md, section 6: unflattened carriers put 9 % rms into an octave T20, flattened ones 1.6 %.
TEST(RirSynthesis, DecayTimeIsThatOfTheEnergy) {
  double sum = 0;
  int count = 0;
  RirSynthesizer synthesizer = mono_at(16000.f, 1.5f);
  for (const double decay_s : {0.2, 0.3, 0.5, 0.8, 1.2}) {
    EnergyResponse response = response_with();
    response.late = decay_of(decay_s, 0.02, 7, 0.004f, 1.5);
    for (const std::uint64_t key : {1ull, 2ull, 3ull}) {
      const Rir rir = rendered(synthesizer, response, 0, key);
      for (const double centre_hz : {125.0, 250.0, 500.0, 1000.0, 2000.0, 4000.0}) {
        const double error = t20_s(octave_band(rir.samples, centre_hz, 16000.0), 16000.0) / decay_s - 1.0;
        sum += error * error;
        ++count;
      }
    }
  }
  EXPECT_LT(std::sqrt(sum / count), 0.02);
}

TEST(RirSynthesis, NoLateSoundBeforeTheDirectSoundAndNoneLost) {
  RirSynthesizer synthesizer = usual_mono();
  // Direct sound after 8.2 ms, that is in bin 2 of 4 ms; the first late energy right behind it reaches into bin 1.
  EnergyResponse response = response_with({arrival_at(0.0082 * 343.0, 0.0)});
  response.late = EnergyHistogram(125, 7, 1, 0.004f);
  const std::vector<float> energy(7, 1.f), sh = {1.f, 0.f, 0.f, 0.f};
  double with_gate = 0, without = 0;
  for (std::uint64_t key = 0; key < 40; ++key) {
    response.late.clear();
    response.late.add(0.0085f, energy, sh);
    const Rir rir = rendered(synthesizer, response, 0, key);
    for (int n = 0; n < 131; ++n) ASSERT_EQ(rir.samples[n], 0.f) << n;  // 131.2
    with_gate += energy_of(rir.samples) / 40;
    EnergyResponse hidden = response;
    hidden.arrivals.clear();
    without += energy_of(rendered(synthesizer, hidden, 0, key).samples) / 40;
  }
  EXPECT_NEAR(db(with_gate), 0.0, 0.5);  // 8 ms of noise: 60 samples of freedom, 40 keys
  EXPECT_NEAR(db(without), 0.0, 0.5);
}

TEST(RirSynthesis, SilenceIsExact) {
  RirSynthesizer synthesizer = usual_mono(), binaural(binaural_tables());
  EnergyResponse response = response_with({arrival_at(3.0, 0.0)});
  response.late = decay_of(0.5, 0.0, 7);
  EXPECT_EQ(energy_of(rendered(synthesizer, response).samples), 0.0);
  EXPECT_EQ(energy_of(rendered(binaural, response).samples), 0.0);
  response.late = EnergyHistogram();
  EXPECT_EQ(energy_of(rendered(binaural, response).samples), 0.0);
}

TEST(RirSynthesis, SameArgumentsGiveTheSameBits) {
  EnergyResponse response = response_with({arrival_at(3.1, 0.1, {0.6f, 0, -0.8f})});
  response.late = decay_of(0.4, 0.02, 7);
  RirSynthesizer one(binaural_tables()), other(binaural_tables());
  const Rir first = rendered(one, response, 0.3, 5);
  rendered(one, response, 1.0, 6);  // leaves scratch dirty
  EXPECT_EQ(rendered(one, response, 0.3, 5).samples, first.samples);
  EXPECT_EQ(rendered(other, response, 0.3, 5).samples, first.samples);
  EXPECT_NE(rendered(one, response, 0.3, 6).samples, first.samples);
  // 36 turns of 10 degrees, counted in integers, come back to the same bits (H-58).
  EXPECT_EQ(rendered(one, response, 36 % 36 * 10 * kDegree, 5).samples, rendered(other, response, 0.0, 5).samples);
}

TEST(RirSynthesis, IsLinearWithoutThresholds) {  // H-37
  EnergyResponse response = response_with({arrival_at(3.1, 0.1, {0.6f, 0, -0.8f})});
  response.late = decay_of(0.4, 0.02, 7);
  RirSynthesizer synthesizer(binaural_tables());
  const Rir reference = rendered(synthesizer, response);
  for (const int exponent : {20, -30}) {
    EnergyResponse scaled = response;
    for (float& value : scaled.arrivals[0].amplitude) value = std::ldexp(value, exponent);
    scaled.late.scale(std::ldexp(1.f, 2 * exponent));
    const Rir rir = rendered(synthesizer, scaled);
    for (std::size_t n = 0; n < rir.samples.size(); ++n) ASSERT_EQ(rir.samples[n], std::ldexp(reference.samples[n], exponent)) << n;
  }
}

TEST(RirSynthesis, SourcesHaveDifferentNoise) {
  EnergyResponse response = response_with();
  response.late = decay_of(1.0, 0.02, 7);
  RirSynthesizer synthesizer = usual_mono();
  const Rir one = rendered(synthesizer, response, 0, 1), other = rendered(synthesizer, response, 0, 0x100000001ull);
  double product = 0;
  for (std::size_t n = 0; n < one.samples.size(); ++n)
    product += static_cast<double>(one.samples[n]) * static_cast<double>(other.samples[n]);
  EXPECT_LT(std::abs(product) / std::sqrt(energy_of(one.samples) * energy_of(other.samples)),
            0.1);  // 1 / sqrt(1700 samples of decay) = 0.024
}

TEST(RirSynthesis, KeptLateSoundChangesNoBit) {
  RirSynthesizer keeping(binaural_tables()), plain(binaural_tables());
  EnergyResponse response = response_with({arrival_at(3.0, 0.1, {0.6f, 0, -0.8f})});
  LateSound cached;
  Rir with, without;
  for (const double level : {1e-2, 3e-3}) {
    response.late = decay_of(0.4, level, BandLayout::octaves(16000.f).size(), 0.004f, 0.5, 1, {0, 0, -1}, 0.5f);
    cached.forget();
    for (const ListenerOrientation& orientation :
         {ListenerOrientation(0.0), ListenerOrientation(1.3), ListenerOrientation(0.4, 0.3, -0.2), ListenerOrientation(-2.0)}) {
      keeping.render(response, orientation, 5, with, &cached);
      plain.render(response, orientation, 5, without);
      ASSERT_EQ(with.samples, without.samples);
    }
  }
}

// A room whose decay is over early has a short response: the start of the long one, up to what the last bin spreads.
TEST(RirSynthesis, ShortHistogramsGiveShortResponses) {
  AcousticConfig config;
  config.rir_length_s = 0.5f;
  const BandLayout bands = BandLayout::octaves(16000.f);
  for (const ChannelLayout layout : {ChannelLayout::mono, ChannelLayout::binaural}) {
    RirSynthesizer synthesizer(make_synthesis_tables(config, bands, layout, nullptr));
    EnergyResponse longer, shorter;
    longer.late = EnergyHistogram(125, bands.size(), 1, 0.004f);
    shorter.late = EnergyHistogram(50, bands.size(), 1, 0.004f);
    std::vector<float> energy(static_cast<std::size_t>(bands.size()), 1e-3f);
    const std::array<float, 4> sh = {1.f, 0.3f, 0.f, -0.5f};
    for (int bin = 0; bin < 50; ++bin) {
      for (EnergyHistogram* late : {&longer.late, &shorter.late}) late->add((static_cast<float>(bin) + 0.5f) * 0.004f, energy, sh);
    }
    longer.arrivals = shorter.arrivals = {arrival_at(3.0, 0.1, {0.6f, 0, -0.8f}), arrival_at(100.0, 0.1, {0, 0, -1})};
    longer.speed_of_sound_m_per_s = shorter.speed_of_sound_m_per_s = 343.f;
    Rir whole, brief;
    synthesizer.render(longer, 0.3, 5, whole);
    synthesizer.render(shorter, 0.3, 5, brief);
    EXPECT_EQ(whole.num_samples, 8000);
    ASSERT_EQ(brief.num_samples, 3200);  // 50 bins of 64 samples
    // The second arrival, at sample 4665, is past the end; the last bin's hat differs over one bin and the head's filters.
    for (int channel = 0; channel < whole.num_channels; ++channel)
      for (int n = 0; n < 3200 - 64 - 160; ++n) ASSERT_NEAR(brief.channel(channel)[n], whole.channel(channel)[n], 1e-6) << n;
    Rir again;
    synthesizer.render(longer, 0.3, 5, again);
    EXPECT_EQ(again.samples, whole.samples);
  }
}

TEST(RirSynthesis, AcceptsAnyShOrder) {
  RirSynthesizer synthesizer(binaural_tables());
  EnergyResponse first = response_with(), third = response_with(), zeroth = response_with(), diffuse = response_with();
  first.late = decay_of(0.4, 0.02, 7, 0.004f, 0.5, 1, {1, 0, 0}, 0.5f);
  third.late = decay_of(0.4, 0.02, 7, 0.004f, 0.5, 3, {1, 0, 0}, 0.5f);
  zeroth.late = decay_of(0.4, 0.02, 7, 0.004f, 0.5, 0);
  diffuse.late = decay_of(0.4, 0.02, 7, 0.004f, 0.5, 1);
  EXPECT_EQ(rendered(synthesizer, first).samples, rendered(synthesizer, third).samples);
  EXPECT_EQ(rendered(synthesizer, zeroth).samples, rendered(synthesizer, diffuse).samples);
}

TEST(RirSynthesis, RefusesWhatDoesNotFit) {
  const BandLayout bands = BandLayout::octaves(16000.f);
  EXPECT_THROW(make_synthesis_tables(config_at(16000.f), bands, ChannelLayout::binaural, Hrtf::rigid_sphere(44100.f)), InputError);
  EXPECT_THROW(make_synthesis_tables(config_at(4000.f), bands, ChannelLayout::mono, nullptr), InputError);
  EXPECT_THROW(make_synthesis_tables(config_at(16000.f, 0.f), bands, ChannelLayout::mono, nullptr), InputError);
  RirSynthesizer synthesizer = usual_mono();
  EnergyResponse response = response_with();
  response.late = decay_of(0.5, 1.0, 4);
  EXPECT_THROW(rendered(synthesizer, response), InputError);
  EnergyResponse no_speed = response_with({arrival_at(1.0, 1.0)});
  no_speed.speed_of_sound_m_per_s = 0;
  EXPECT_THROW(rendered(synthesizer, no_speed), InputError);
}

}  // namespace
}  // namespace earshot
