// SPDX-License-Identifier: Apache-2.0
// Spectra of rendered arrivals: air as ISO 9613-1 has it at every frequency, and no steps between bands.

#include "sim/acoustics/synthesis/arrival_spectrum.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <complex>
#include <numbers>
#include <span>
#include <vector>

#include "sim/acoustics/model/air_absorption.h"
#include "sim/base/random.h"
#include "tests/support/acoustics/synthesis_cases.h"

namespace earshot {
namespace {

using namespace synthesis_cases;

constexpr std::array<float, 6> kRatesHz = {8000.f, 11025.f, 16000.f, 22050.f, 44100.f, 48000.f};

/// Air, as a scene with it in all bands has it.
AirLoss loss_of(const Air& air, const BandLayout& bands) {
  AirLoss loss{.curve = air_curve(air), .band_per_m = {}};
  for (std::size_t b = 0; b < bands.centre_hz.size(); ++b)
    loss.band_per_m[b] = static_cast<float>(air_absorption_energy_per_m(air, double{bands.centre_hz[b]}));
  return loss;
}

struct DrawnAir {
  explicit DrawnAir(std::uint32_t draw) : random(38, Purpose::test, 22, draw) {
    air.temperature_c = -20.f + 70.f * random.uniform(0);
    air.humidity_percent = 100.f * random.uniform(1);
    rate_hz = kRatesHz[draw % kRatesHz.size()];
    distance_m = 1.0 + 150.0 * double{random.uniform(2)};
    bands = draw % 3 == 2 ? BandLayout::log_spaced(1 + static_cast<int>(random.below(16, 3)), rate_hz)
                          : BandLayout::octaves(rate_hz, draw % 3 == 1);
  }
  RandomStream random;
  Air air;
  float rate_hz;
  double distance_m;
  BandLayout bands;
};

/// An arrival in this air, of unit amplitude without it.
EnergyResponse response_in(const DrawnAir& drawn) {
  EnergyResponse response = response_with({arrival_at(drawn.distance_m, 1.0)});
  response.air = loss_of(drawn.air, drawn.bands);
  for (std::size_t b = 0; b < drawn.bands.centre_hz.size(); ++b)
    response.arrivals[0].amplitude[b] *= static_cast<float>(std::exp(-0.5 * double{response.air.band_per_m[b]} * drawn.distance_m));
  return response;
}

/// From 100 Hz to 0.45 of the rate, where it has lost less than 60 dB.
void expect_air(const std::vector<std::complex<float>>& spectrum, const DrawnAir& drawn, double tolerance_db) {
  const double bin_hz = double{drawn.rate_hz} / static_cast<double>(2 * (spectrum.size() - 1));
  for (std::size_t k = 0; static_cast<double>(k) * bin_hz < 0.45 * double{drawn.rate_hz}; ++k) {
    const double frequency_hz = static_cast<double>(k) * bin_hz;
    const double loss_db = drawn.distance_m * air_absorption_db_per_m(drawn.air, frequency_hz);
    if (frequency_hz < 100 || loss_db > 60) continue;
    ASSERT_NEAR(20 * std::log10(std::abs(std::complex<double>(spectrum[k]))), -loss_db, tolerance_db)
        << frequency_hz << " Hz, " << drawn.distance_m << " m, " << drawn.rate_hz << " Hz";
  }
}

// Single precision.  A wrong centre of the highest band alone was 1.2 dB off, a step between bands 3 dB.
TEST(ArrivalSpectrum, HasTheAirOfEachFrequency) {
  for (std::uint32_t draw = 0; draw < 60; ++draw) {
    const DrawnAir drawn(draw);
    const EnergyResponse response = response_in(drawn);
    const BandFilters filters(drawn.bands, drawn.rate_hz, 1024, BandShape::line);
    ArrivalSpectrum arrival(filters);
    arrival.set_air(response.air);
    const auto bands = static_cast<std::size_t>(drawn.bands.size());
    // Phases take another way through the code; equal ones change no size.
    std::vector<float> phase(bands, draw % 2 == 0 ? 0.f : 1.f);
    arrival.set(std::span(response.arrivals[0].amplitude).first(bands), phase, drawn.distance_m);
    std::vector<std::complex<float>> spectrum(filters.num_bins(), 1.f);
    arrival.apply(spectrum);
    expect_air(spectrum, drawn, 0.01);
  }
}

// Rendered: also the delay by parts of a sample, and what the transform of an arrival cuts.
TEST(ArrivalSpectrum, RenderedDirectSoundHasTheAirOfEachFrequency) {
  for (std::uint32_t draw = 0; draw < 3; ++draw) {
    const DrawnAir drawn(draw);
    RirSynthesizer synthesizer(make_synthesis_tables(config_at(drawn.rate_hz, 0.6f), drawn.bands, ChannelLayout::mono, nullptr));
    expect_air(spectrum_of(rendered(synthesizer, response_in(drawn)).samples), drawn, 0.1);
  }
}

// Whatever the walls took: the values of the bands at their centres, and straight lines between them in log frequency.
TEST(ArrivalSpectrum, GainsGoStraightFromCentreToCentre) {
  for (std::uint32_t draw = 0; draw < 12; ++draw) {
    const DrawnAir drawn(draw);
    const BandFilters filters(drawn.bands, drawn.rate_hz, 4096, BandShape::line);
    const std::vector<float>& centre_hz = drawn.bands.centre_hz;
    std::vector<float> amplitude(centre_hz.size()), phase(centre_hz.size());
    for (std::size_t b = 0; b < amplitude.size(); ++b) {
      amplitude[b] = 0.05f + drawn.random.uniform(10 + static_cast<std::uint32_t>(b));
      phase[b] = draw % 2 == 0 ? 0.f : 3.f * drawn.random.uniform(50 + static_cast<std::uint32_t>(b));
    }
    ArrivalSpectrum arrival(filters);
    arrival.set(amplitude, phase, drawn.distance_m);
    std::vector<std::complex<float>> spectrum(filters.num_bins(), 1.f);
    arrival.apply(spectrum);
    for (std::size_t k = 0; k < spectrum.size(); ++k) {
      const double frequency_hz = static_cast<double>(k) * filters.bin_hz();
      const auto above =
          static_cast<std::size_t>(std::ranges::upper_bound(centre_hz, static_cast<float>(frequency_hz)) - centre_hz.begin());
      const std::size_t low = above == 0 ? 0 : above - 1, high = std::min(above, centre_hz.size() - 1);
      const double way =
          low == high ? 0.0 : std::log(frequency_hz / double{centre_hz[low]}) / std::log(double{centre_hz[high]} / double{centre_hz[low]});
      const double expected = double{amplitude[low]} + way * (double{amplitude[high]} - double{amplitude[low]});
      ASSERT_NEAR(std::abs(std::complex<double>(spectrum[k])), expected, 1e-5) << frequency_hz << ", " << draw;
      const double turn = double{phase[low]} + way * (double{phase[high]} - double{phase[low]});
      ASSERT_NEAR(std::remainder(std::arg(std::complex<double>(spectrum[k])) - turn, 2 * std::numbers::pi), 0.0, 1e-4) << frequency_hz;
    }
  }
}

// Far away nothing is left, and nothing becomes a NaN: the loss of a band is undone up to 347 dB.
TEST(ArrivalSpectrum, EndlessWaysAreSilent) {
  for (std::uint32_t draw = 0; draw < 12; ++draw) {
    const DrawnAir drawn(draw);
    const BandFilters filters(drawn.bands, drawn.rate_hz, 512, BandShape::line);
    ArrivalSpectrum arrival(filters);
    arrival.set_air(loss_of(drawn.air, drawn.bands));
    std::vector<float> amplitude(drawn.bands.centre_hz.size(), 1e-6f);
    const std::vector<float> phase(amplitude.size(), draw % 2 == 0 ? 0.f : 1.f);
    for (const double distance_m : {1e4, 1e6, 1e30}) {
      arrival.set(amplitude, phase, distance_m);
      std::vector<std::complex<float>> spectrum(filters.num_bins(), 1.f);
      arrival.apply(spectrum);
      for (const std::complex<float> value : spectrum) ASSERT_TRUE(std::isfinite(value.real()) && std::isfinite(value.imag())) << draw;
    }
  }
}

}  // namespace
}  // namespace earshot
