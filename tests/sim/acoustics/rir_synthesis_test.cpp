#include "sim/acoustics/rir_synthesis.h"

#include <gtest/gtest.h>

#include <cmath>
#include <complex>
#include <numbers>

#include "sim/acoustics/band_filters.h"
#include "sim/acoustics/carriers.h"
#include "sim/audio/ambisonics.h"
#include "sim/audio/fft.h"
#include "sim/base/errors.h"
#include "sim/base/random.h"

namespace earshot {
namespace {

constexpr double kDegree = std::numbers::pi / 180.0;

AcousticConfig config_at(float rate_hz, float length_s = 0.5f) {
  AcousticConfig config;
  config.sample_rate_hz = rate_hz;
  config.rir_length_s = length_s;
  return config;
}

RirSynthesizer mono_at(float rate_hz, float length_s = 0.5f, int bands = 0) {
  const BandLayout layout = bands > 0 ? BandLayout::log_spaced(bands, rate_hz) : BandLayout::octaves(rate_hz);
  return RirSynthesizer(make_synthesis_tables(config_at(rate_hz, length_s), layout, ChannelLayout::mono, nullptr));
}

/// Half a second, octaves, 16 kHz: tables made once.
RirSynthesizer usual_mono() {
  static const auto tables = make_synthesis_tables(config_at(16000.f), BandLayout::octaves(16000.f), ChannelLayout::mono, nullptr);
  return RirSynthesizer(tables);
}

/// Tables of half a second, binaural, 16 kHz: made once, as they take half a second.
std::shared_ptr<const SynthesisTables> binaural_tables() {
  static const auto tables = make_synthesis_tables(config_at(16000.f), BandLayout::octaves(16000.f), ChannelLayout::binaural, Hrtf::rigid_sphere(16000.f));
  return tables;
}

Arrival arrival_at(double distance_m, double amplitude, glm::vec3 direction = {0, 0, -1}, int order = 0) {
  Arrival arrival;
  arrival.distance_m = static_cast<float>(distance_m);
  arrival.direction = direction;
  arrival.order = order;
  arrival.amplitude.fill(static_cast<float>(amplitude));
  return arrival;
}

EnergyResponse response_with(std::vector<Arrival> arrivals = {}) {
  EnergyResponse response;
  response.speed_of_sound_m_per_s = 343.f;
  response.arrivals = std::move(arrivals);
  return response;
}

/// exp(-13.8 t / decay_time) with total energy `total` per band, all from `direction` with weight `directivity`.
EnergyHistogram decay_of(double decay_time_s, double total, int num_bands, float bin_s = 0.004f, double length_s = 0.5, int sh_order = 1,
                         glm::vec3 direction = {0, 0, -1}, float directivity = 0) {
  const int num_bins = static_cast<int>(std::lround(length_s / static_cast<double>(bin_s)));
  EnergyHistogram histogram(num_bins, num_bands, sh_order, bin_s);
  const double k = 6.0 * std::log(10.0) / decay_time_s;
  std::vector<float> sh(static_cast<std::size_t>(histogram.num_coefficients()));
  spherical_harmonics_n3d(direction, sh_order, sh);
  for (int bin = 0; bin < num_bins; ++bin) {
    const double begin = bin * static_cast<double>(bin_s), end = begin + static_cast<double>(bin_s);
    const auto energy = static_cast<float>(total * (std::exp(-k * begin) - std::exp(-k * end)));
    for (int band = 0; band < num_bands; ++band) {
      float* cell = histogram.values().data() + static_cast<std::ptrdiff_t>((bin * num_bands + band) * histogram.num_coefficients());
      cell[0] = energy;
      for (std::size_t c = 1; c < sh.size(); ++c) cell[c] = energy * directivity * sh[c];
    }
  }
  return histogram;
}

Rir rendered(RirSynthesizer& synthesizer, const EnergyResponse& response, double heading_rad = 0, std::uint64_t key = 1) {
  Rir rir;
  synthesizer.render(response, heading_rad, key, rir);
  return rir;
}
Rir rendered(RirSynthesizer&& synthesizer, const EnergyResponse& response) { return rendered(synthesizer, response); }

double energy_of(std::span<const float> samples) {
  double sum = 0;
  for (const float value : samples) sum += static_cast<double>(value) * value;
  return sum;
}
double db(double ratio) { return 10.0 * std::log10(ratio); }

std::vector<std::complex<float>> spectrum_of(std::span<const float> samples) {
  RealFft fft(next_power_of_two(static_cast<int>(2 * samples.size())));
  std::vector<std::complex<float>> spectrum(static_cast<std::size_t>(fft.num_bins()));
  fft.forward(samples, spectrum);
  return spectrum;
}

/// Least-squares slope of the unwrapped phase, as a delay in samples.
double phase_delay(std::span<const float> samples, double from, double to) {
  const auto spectrum = spectrum_of(samples);
  const auto size = static_cast<double>(2 * (spectrum.size() - 1));
  double phase = 0, before = 0, sxy = 0, sxx = 0;
  for (std::size_t k = 1; k < spectrum.size(); ++k) {
    const double now = std::arg(spectrum[k]);
    phase += std::remainder(now - before, 2.0 * std::numbers::pi);
    before = now;
    const double x = 2.0 * std::numbers::pi * static_cast<double>(k) / size;
    if (x < from * std::numbers::pi || x > to * std::numbers::pi) continue;
    sxy += x * phase;
    sxx += x * x;
  }
  return -sxy / sxx;
}

/// Zero-phase octave band, power edges half an octave wide: written for the tests.
std::vector<float> octave_band(std::span<const float> samples, double centre_hz, double rate_hz) {
  RealFft fft(next_power_of_two(static_cast<int>(2 * samples.size())));
  std::vector<std::complex<float>> spectrum(static_cast<std::size_t>(fft.num_bins()));
  fft.forward(samples, spectrum);
  for (std::size_t k = 0; k < spectrum.size(); ++k) {
    const double octaves = std::abs(std::log2(std::max(1e-9, static_cast<double>(k) * rate_hz / fft.size() / centre_hz)));
    spectrum[k] *= static_cast<float>(std::cos(0.5 * std::numbers::pi * std::clamp((octaves - 0.25) / 0.5, 0.0, 1.0)));
  }
  std::vector<float> filtered(static_cast<std::size_t>(fft.size()));
  fft.inverse(spectrum, filtered);
  filtered.resize(samples.size());
  return filtered;
}

/// Decay time from a line through the Schroeder curve between -5 and -25 dB.
double t20_s(std::span<const float> samples, double rate_hz) {
  std::vector<double> level(samples.size());
  double sum = 0;
  for (std::size_t i = samples.size(); i-- > 0;) level[i] = sum += static_cast<double>(samples[i]) * samples[i];
  double n = 0, sx = 0, sy = 0, sxx = 0, sxy = 0;
  for (std::size_t i = 0; i < level.size(); ++i) {
    const double y = db(level[i] / sum), x = static_cast<double>(i) / rate_hz;
    if (y > -5) continue;
    if (y < -25) break;
    n += 1, sx += x, sy += y, sxx += x * x, sxy += x * y;
  }
  return -60.0 / ((n * sxy - sx * sy) / (n * sxx - sx * sx));
}

// ---- band filters -------------------------------------------------------------------------------------------------------------------

TEST(BandFilters, SharesAddUpToOne) {
  for (const float rate : {8000.f, 16000.f, 48000.f}) {
    for (const int count : {1, 2, 3, 5, 8, 12, 31}) {
      const BandFilters filters(BandLayout::log_spaced(count, rate), rate, 1024);
      for (std::size_t k = 0; k < filters.num_bins(); ++k) {
        double sum = 0;
        for (int band = 0; band < filters.num_bands(); ++band) {
          EXPECT_GE(filters.share(band, k), 0.f);
          sum += static_cast<double>(filters.share(band, k));
        }
        ASSERT_NEAR(sum, 1.0, 1e-7) << count << " bin " << k;
      }
    }
  }
}

TEST(BandFilters, PassTheirCentreAndHalveAtTheEdge) {
  const BandLayout bands = BandLayout::octaves(16000.f);
  const BandFilters filters(bands, 16000.f, 1 << 16);
  const auto bin = [](double frequency_hz) { return static_cast<std::size_t>(std::lround(frequency_hz / 16000.0 * 65536.0)); };
  for (int band = 0; band < bands.size(); ++band) {
    EXPECT_EQ(filters.share(band, bin(static_cast<double>(bands.centre_hz[band]))), 1.f);
    if (band > 0) { EXPECT_NEAR(filters.share(band, bin(static_cast<double>(bands.edge_hz[band]))), 0.5, 5e-3); }  // bins of 0.24 Hz
  }
  EXPECT_EQ(filters.share(0, 0), 1.f);
  EXPECT_EQ(filters.share(6, filters.num_bins() - 1), 1.f);
}

TEST(BandFilters, EqualGainsPassExactly) {
  const BandFilters filters(BandLayout::log_spaced(31, 48000.f), 48000.f, 1024);
  std::vector<float> gain(filters.num_bins());
  filters.blend(std::vector<float>(31, 0.1f), gain);
  for (const float value : gain) ASSERT_EQ(value, 0.1f);
}

// ---- carriers -----------------------------------------------------------------------------------------------------------------------

TEST(Carriers, BandsAddUpToWhiteNoiseOfUnitVariance) {
  for (const int count : {1, 4, 12}) {
    const BandLayout bands = BandLayout::log_spaced(count, 16000.f);
    const CarrierBank bank(bands, 16000.f, 4, 8192, 7);
    for (int channel = 0; channel < 4; ++channel) {
      std::vector<float> sum(bank.length(), 0.f);
      for (int band = 0; band < bands.size(); ++band)
        for (std::size_t n = 0; n < sum.size(); ++n) sum[n] += bank.loop(band, channel)[n];
      EXPECT_NEAR(energy_of(sum) / 8192, 1.0, 1e-3);  // ORACLES O-31: uniform noise in [-1, 1) would be 4.8 dB short
      RealFft fft(8192);
      std::vector<std::complex<float>> spectrum(4097);
      fft.forward(sum, spectrum);
      for (std::size_t k = 1; k < 4096; ++k) ASSERT_NEAR(std::norm(spectrum[k]) / 8192, 1.f, 1e-3f) << k;
    }
  }
}

TEST(Carriers, ChannelsAreIndependent) {
  const BandLayout bands = BandLayout::octaves(16000.f);
  const CarrierBank bank(bands, 16000.f, 4, 16384, 7);
  for (int band = 0; band < bands.size(); ++band) {
    for (int a = 0; a < 4; ++a) {
      for (int b = 0; b < a; ++b) {
        double product = 0;
        for (std::size_t n = 0; n < bank.length(); ++n) product += static_cast<double>(bank.loop(band, a)[n]) * static_cast<double>(bank.loop(band, b)[n]);
        // Chance alone gives the lowest band, 180 Hz wide for a second, 1 / sqrt(2 * 180) = 0.05 rms.
        EXPECT_LT(std::abs(product) / energy_of(bank.loop(band, a)), 0.1) << band;
      }
    }
  }
}

TEST(Carriers, DependOnTheSeedAlone) {
  const BandLayout bands = BandLayout::octaves(16000.f);
  const CarrierBank one(bands, 16000.f, 1, 4096, 7), same(bands, 16000.f, 1, 4096, 7), other(bands, 16000.f, 1, 4096, 8), four(bands, 16000.f, 4, 4096, 7);
  const auto bits = [](const CarrierBank& bank, int band) { return std::vector<float>(bank.loop(band, 0).begin(), bank.loop(band, 0).end()); };
  EXPECT_EQ(bits(one, 3), bits(same, 3));
  EXPECT_NE(bits(one, 3), bits(other, 3));
  EXPECT_EQ(bits(one, 3), bits(four, 3));  // the omnidirectional carrier is that of a mono response
}

// ---- arrivals -----------------------------------------------------------------------------------------------------------------------

TEST(RirSynthesis, DirectSoundAtAWholeSampleIsOneSample) {  // ORACLES O-1: 3.43 m, 10 ms, 0.02320043
  for (const auto& [rate, sample] : {std::pair{16000.f, 160}, {44100.f, 441}, {48000.f, 480}}) {
    const Rir rir = rendered(mono_at(rate, 0.1f), response_with({arrival_at(3.43, 0.02320043)}));
    ASSERT_EQ(rir.num_channels, 1);
    ASSERT_EQ(rir.num_samples, static_cast<int>(std::lround(0.1 * static_cast<double>(rate))));
    for (int n = 0; n < rir.num_samples; ++n) ASSERT_EQ(rir.samples[n], n == sample ? 0.02320043f : 0.f) << rate << ' ' << n;
  }
}

TEST(RirSynthesis, DelayIsExactToAThousandthOfASample) {
  for (const float rate : {8000.f, 16000.f, 44100.f}) {
    RirSynthesizer synthesizer = mono_at(rate, 0.1f);
    for (const double distance_m : {1.0, 2.0, 2.005, 5.0, 7.77}) {
      const Rir rir = rendered(synthesizer, response_with({arrival_at(distance_m, 1.0)}));
      EXPECT_NEAR(phase_delay(rir.samples, 0.05, 0.9), distance_m / 343.0 * static_cast<double>(rate), 1e-3) << rate << ' ' << distance_m;
    }
  }
}

TEST(RirSynthesis, DirectEnergyIsTheSameAtAllRates) {  // O-1, H-31
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
  const auto render_with = [](int bands) {
    EnergyResponse response = response_with({arrival_at(4.2, 0.1), arrival_at(7.3, 0.05, {0, 0, -1}, 1)});
    response.late = decay_of(0.4, 1e-2, BandLayout::log_spaced(bands, 16000.f).size());
    return rendered(mono_at(16000.f, 0.5f, bands), response);
  };
  const double expected = 0.1 * 0.1 + 0.05 * 0.05 + 1e-2;
  for (const int bands : {1, 2, 5, 8, 31}) EXPECT_NEAR(db(energy_of(render_with(bands).samples) / expected), 0.0, 0.1) << bands;
}

TEST(RirSynthesis, ArrivalsOutsideTheResponseAreDropped) {  // H-11, H-32, H-33
  RirSynthesizer synthesizer = mono_at(16000.f, 0.05f);
  for (const double distance_m : {100.0, 1e6, 1e30}) {
    const Rir rir = rendered(synthesizer, response_with({arrival_at(distance_m, 1.0)}));
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

// ---- late field, one channel --------------------------------------------------------------------------------------------------------

TEST(RirSynthesis, LateEnergyIsWhatWasPutIn) {  // ORACLES 2.6 (b); DESIGN.md, pressure scale
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

TEST(RirSynthesis, LateSpectrumIsFlat) {  // ORACLES 2.6 (c)
  RirSynthesizer synthesizer = usual_mono();
  EnergyResponse response = response_with();
  response.late = decay_of(0.8, 0.02, 7);
  const Rir rir = rendered(synthesizer, response);
  const auto spectrum = spectrum_of(rir.samples);
  const auto size = static_cast<double>(2 * (spectrum.size() - 1));
  const double put_in = 0.02 * (1.0 - std::exp(-6.0 * std::log(10.0) * 0.5 / 0.8));
  for (int band = 0; band < 6; ++band) {
    const double centre_hz = 1000.0 * std::pow(10.0, 0.3 * (band - 3));
    double sum = 0, count = 0;
    for (auto k = static_cast<std::size_t>(centre_hz / 1.41 / 16000.0 * size); static_cast<double>(k) < centre_hz * 1.41 / 16000.0 * size; ++k, ++count) sum += std::norm(spectrum[k]);
    EXPECT_NEAR(db(sum / count / put_in), 0.0, 0.5) << centre_hz;
  }
}

TEST(RirSynthesis, BandEnergiesStayInTheirBands) {
  RirSynthesizer synthesizer = usual_mono();
  EnergyResponse response = response_with();
  response.late = decay_of(0.5, 0.0, 7);
  for (int bin = 0; bin < response.late.num_bins(); ++bin) response.late.values()[static_cast<std::size_t>((bin * 7 + 3) * 4)] = 1.f;  // 1 kHz only
  const Rir rir = rendered(synthesizer, response);
  const double inside = energy_of(octave_band(rir.samples, 1000.0, 16000.0));
  for (const double centre_hz : {125.0, 250.0, 4000.0}) EXPECT_LT(db(energy_of(octave_band(rir.samples, centre_hz, 16000.0)) / inside), -40) << centre_hz;  // the sudden start of the tail splatters
}

// ORACLES 2.6: unflattened carriers put 9 % rms into an octave T20, flattened ones 1.6 %.
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
  for (std::size_t n = 0; n < one.samples.size(); ++n) product += static_cast<double>(one.samples[n]) * static_cast<double>(other.samples[n]);
  EXPECT_LT(std::abs(product) / std::sqrt(energy_of(one.samples) * energy_of(other.samples)), 0.1);  // 1 / sqrt(1700 samples of decay) = 0.024
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

// ---- two ears -----------------------------------------------------------------------------------------------------------------------

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
  // Low frequencies arrive when the wave passes the centre of the head, half of 753.7 us early at the right ear and as late at the left (O-27, ears at +-100).
  const auto at_right = spectrum_of(right.channel(1)), at_left = spectrum_of(right.channel(0));
  const double size = 2.0 * static_cast<double>(at_right.size() - 1), frequency_hz = 200.0;
  const auto k = static_cast<std::size_t>(std::lround(frequency_hz / 16000.0 * size));
  const double turn = std::remainder(std::arg(at_right[k]) + std::arg(at_left[k]) + 2.0 * 2.0 * std::numbers::pi * static_cast<double>(k) / size * (5.0 / 343.0 * 16000.0), 2.0 * std::numbers::pi);
  EXPECT_NEAR(turn / 2.0, 0.0, 0.02);  // of a turn of 2 pi per 5 ms: 16 us
  EXPECT_NEAR(std::arg(at_right[k] * std::conj(at_left[k])) / (2.0 * std::numbers::pi * static_cast<double>(k) * 16000.0 / size) * 1e6, 766.4, 15.0);
  const Rir front = rendered(synthesizer, response_with({arrival_at(5.0, 1.0, {0, 0, -1})}));
  for (int n = 0; n < front.num_samples; ++n) ASSERT_EQ(front.channel(0)[n], front.channel(1)[n]);
}

TEST(BinauralSynthesis, DirectSoundAtLowFrequenciesHasItsAmplitude) {
  RirSynthesizer synthesizer(binaural_tables());
  const Rir rir = rendered(synthesizer, response_with({arrival_at(20.0, 0.25, {0.6f, 0, -0.8f})}));
  for (int ear = 0; ear < 2; ++ear) EXPECT_NEAR(std::abs(spectrum_of(rir.channel(ear))[10]) / 0.25, 1.0, 0.02);  // 10 Hz: the head is not there
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

struct LateEars {
  double left = 0, right = 0, coherence_500 = 0, coherence_1000 = 0, coherence_250 = 0;
};

/// Levels and coherence of the late field over many keys.
LateEars late_ears(const EnergyHistogram& late, double heading_rad) {
  RirSynthesizer synthesizer(binaural_tables());
  EnergyResponse response = response_with();
  response.late = late;
  LateEars result;
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
      for (auto k = static_cast<std::size_t>(centre_hz[f] * 0.95 / 16000.0 * size); static_cast<double>(k) < centre_hz[f] * 1.05 / 16000.0 * size; ++k) {
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

// Finding 9 of ORACLES 0.2: pressure noise times spherical harmonics gives 1.0 here.
TEST(BinauralSynthesis, DiffuseTailHasTheCoherenceOfAHead) {
  const LateEars ears = late_ears(decay_of(2.0, 0.02, 7), 0.7);
  EXPECT_NEAR(ears.coherence_250, 0.7636, 0.1);
  EXPECT_NEAR(ears.coherence_500, 0.2037, 0.1);
  EXPECT_NEAR(ears.coherence_1000, -0.1251, 0.1);
  EXPECT_NEAR(db(ears.left / ears.right), 0.0, 0.2);
}

// Power at an ear in a diffuse field over that of the centre without the head: from O-27's sphere, about +2 dB above 2 kHz, 0 dB at low frequencies.
TEST(BinauralSynthesis, DiffuseTailHasTheLevelOfAHead) {
  const double put_in = 0.02 * (1.0 - std::exp(-6.0 * std::log(10.0) * 0.5 / 2.0));
  double expected = 0;  // mean over frequency of the decoder's diffuse power, itself tested against the exact series in hrtf_test
  const auto head = Hrtf::rigid_sphere(16000.f);
  const auto bins = static_cast<std::size_t>(head->fft_size() / 2 + 1);
  for (std::size_t k = 0; k < bins; ++k)
    for (int c = 0; c < 4; ++c) expected += std::norm(head->diffuse_decoder(c, 0)[k]) / static_cast<double>(bins);
  const LateEars ears = late_ears(decay_of(2.0, 0.02, 7), 0.0);
  EXPECT_NEAR(db(ears.left / (put_in * expected)), 0.0, 0.2);
  EXPECT_NEAR(db(ears.right / (put_in * expected)), 0.0, 0.2);
}

TEST(BinauralSynthesis, DirectionalTailIsLouderOnItsSideAndTurnsWithTheHead) {
  const EnergyHistogram from_right = decay_of(2.0, 0.02, 7, 0.004f, 0.5, 1, {1, 0, 0}, 0.9f);
  const LateEars facing = late_ears(from_right, 0.0), turned_right = late_ears(from_right, -90 * kDegree), turned_back = late_ears(from_right, 180 * kDegree);
  EXPECT_GT(db(facing.right / facing.left), 4.0);
  EXPECT_NEAR(db(turned_right.right / turned_right.left), 0.0, 0.5);  // now in front
  EXPECT_NEAR(db(turned_back.left / turned_back.right), db(facing.right / facing.left), 0.5);
  // A plane wave from the front is coherent at the ears.
  EXPECT_GT(late_ears(decay_of(2.0, 0.02, 7, 0.004f, 0.5, 1, {0, 0, -1}, 1.f), 0.0).coherence_500, 0.98);
}

// Ears mix four carriers.  For these short decays plain noise gives 15 % rms; flattening is bounded by the few degrees of freedom at 125 Hz.
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
  EXPECT_LT(std::sqrt(sum / count), 0.045);
}

// ---- wrong use ----------------------------------------------------------------------------------------------------------------------

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
