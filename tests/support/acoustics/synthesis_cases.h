// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <algorithm>
#include <cmath>
#include <complex>
#include <memory>
#include <numbers>
#include <span>
#include <vector>

#include "sim/acoustics/synthesis/rir_synthesis.h"
#include "sim/audio/head/ambisonics.h"
#include "sim/audio/transforms/fft.h"

/// Responses to render and measurements of what came out, for the tests of RIR synthesis.
namespace earshot::synthesis_cases {

inline constexpr double kDegree = std::numbers::pi / 180.0;

inline AcousticConfig config_at(float rate_hz, float length_s = 0.5f) {
  AcousticConfig config;
  config.sample_rate_hz = rate_hz;
  config.rir_length_s = length_s;
  return config;
}

inline RirSynthesizer mono_at(float rate_hz, float length_s = 0.5f, int bands = 0) {
  const BandLayout layout = bands > 0 ? BandLayout::log_spaced(bands, rate_hz) : BandLayout::octaves(rate_hz);
  return RirSynthesizer(make_synthesis_tables(config_at(rate_hz, length_s), layout, ChannelLayout::mono, nullptr));
}

/// Half a second, octaves, 16 kHz: tables made once.
inline RirSynthesizer usual_mono() {
  static const auto tables = make_synthesis_tables(config_at(16000.f), BandLayout::octaves(16000.f), ChannelLayout::mono, nullptr);
  return RirSynthesizer(tables);
}

/// Tables of half a second, binaural, 16 kHz: made once, as they take half a second.
inline std::shared_ptr<const SynthesisTables> binaural_tables() {
  static const auto tables =
      make_synthesis_tables(config_at(16000.f), BandLayout::octaves(16000.f), ChannelLayout::binaural, Hrtf::rigid_sphere(16000.f));
  return tables;
}

inline Arrival arrival_at(double distance_m, double amplitude, glm::vec3 direction = {0, 0, -1}, int order = 0) {
  Arrival arrival;
  arrival.distance_m = static_cast<float>(distance_m);
  arrival.direction = direction;
  arrival.order = order;
  arrival.kind = order == 0 ? ArrivalKind::direct : ArrivalKind::reflection;
  arrival.amplitude.fill(static_cast<float>(amplitude));
  return arrival;
}

inline EnergyResponse response_with(std::vector<Arrival> arrivals = {}) {
  EnergyResponse response;
  response.speed_of_sound_m_per_s = 343.f;
  response.arrivals = std::move(arrivals);
  return response;
}

/// exp(-13.8 t / decay_time) with total energy `total` per band, all from `direction` with weight `directivity`.
inline EnergyHistogram decay_of(double decay_time_s, double total, int num_bands, float bin_s = 0.004f, double length_s = 0.5,
                                int sh_order = 1, glm::vec3 direction = {0, 0, -1}, float directivity = 0) {
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

inline Rir rendered(RirSynthesizer& synthesizer, const EnergyResponse& response, double heading_rad = 0, std::uint64_t key = 1) {
  Rir rir;
  synthesizer.render(response, heading_rad, key, rir);
  return rir;
}
inline Rir rendered(RirSynthesizer&& synthesizer, const EnergyResponse& response) { return rendered(synthesizer, response); }

inline double energy_of(std::span<const float> samples) {
  double sum = 0;
  for (const float value : samples) sum += static_cast<double>(value) * value;
  return sum;
}
inline double db(double ratio) { return 10.0 * std::log10(ratio); }

inline std::vector<std::complex<float>> spectrum_of(std::span<const float> samples) {
  RealFft fft(next_power_of_two(static_cast<int>(2 * samples.size())));
  std::vector<std::complex<float>> spectrum(static_cast<std::size_t>(fft.num_bins()));
  fft.forward(samples, spectrum);
  return spectrum;
}

/// Least-squares slope of the unwrapped phase, as a delay in samples.
inline double phase_delay(std::span<const float> samples, double from, double to) {
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
inline std::vector<float> octave_band(std::span<const float> samples, double centre_hz, double rate_hz) {
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
inline double t20_s(std::span<const float> samples, double rate_hz) {
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

}  // namespace earshot::synthesis_cases
