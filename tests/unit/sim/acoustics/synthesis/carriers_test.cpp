// SPDX-License-Identifier: Apache-2.0
#include "sim/acoustics/synthesis/carriers.h"

#include <gtest/gtest.h>

#include "sim/acoustics/synthesis/band_filters.h"
#include "sim/base/files.h"
#include "tests/support/acoustics/synthesis_cases.h"

namespace earshot {
namespace {

using namespace synthesis_cases;

// The bits of every rendered late field hang on these values.
TEST(CarrierKey, IsTheHashOfSceneAndPlaceOrTheScene) {
  struct {
    std::uint64_t scene = 0x0123456789ABCDEF;
    float position[3] = {1.5f, -2.f, 0.25f};
    std::uint32_t padding = 0;
  } identity;
  const std::uint64_t by_place = carrier_key(identity.scene, glm::vec3(1.5f, -2.f, 0.25f));
  EXPECT_EQ(by_place, hash64(std::as_bytes(std::span(&identity, 1)).first(20)));
  EXPECT_NE(by_place, carrier_key(identity.scene + 1, glm::vec3(1.5f, -2.f, 0.25f)));
  EXPECT_NE(by_place, carrier_key(identity.scene, glm::vec3(1.5f, -2.f, 0.5f)));
  EXPECT_EQ(carrier_key(identity.scene), identity.scene);
}

TEST(BandFilters, WeightsAddUpToOneO31) {
  for (const float rate : {8000.f, 16000.f, 48000.f}) {
    for (const int count : {1, 2, 3, 5, 8, 12, 31}) {
      const BandFilters filters(BandLayout::log_spaced(count, rate), rate, 1024);
      for (std::size_t k = 0; k < filters.num_bins(); ++k) {
        double sum = 0;
        for (int band = 0; band < filters.num_bands(); ++band) {
          EXPECT_GE(filters.weight(band, k), 0.f);
          sum += static_cast<double>(filters.weight(band, k));
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
    EXPECT_EQ(filters.weight(band, bin(static_cast<double>(bands.centre_hz[band]))), 1.f);
    if (band > 0) {
      EXPECT_NEAR(filters.weight(band, bin(static_cast<double>(bands.edge_hz[band]))), 0.5, 5e-3);
    }  // bins of 0.24 Hz
  }
  EXPECT_EQ(filters.weight(0, 0), 1.f);
  EXPECT_EQ(filters.weight(6, filters.num_bins() - 1), 1.f);
}

TEST(BandFilters, EqualGainsPassExactly) {
  const BandFilters filters(BandLayout::log_spaced(31, 48000.f), 48000.f, 1024);
  std::vector<float> gain(filters.num_bins());
  filters.blend(std::vector<float>(31, 0.1f), gain);
  for (const float value : gain) ASSERT_EQ(value, 0.1f);
}

TEST(Carriers, BandsAddUpToWhiteNoiseOfUnitVarianceO31) {
  for (const int count : {1, 4, 12}) {
    const BandLayout bands = BandLayout::log_spaced(count, 16000.f);
    const CarrierBank bank(bands, 16000.f, 4, 8192, 7);
    for (int channel = 0; channel < 4; ++channel) {
      std::vector<float> sum(bank.length(), 0.f);
      for (int band = 0; band < bands.size(); ++band)
        for (std::size_t n = 0; n < sum.size(); ++n) sum[n] += bank.loop(band, channel)[n];
      EXPECT_NEAR(energy_of(sum) / 8192, 1.0, 1e-3);  // docs/evidence/oracles.md, O-31: uniform noise in [-1, 1) would be 4.8 dB short
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
        for (std::size_t n = 0; n < bank.length(); ++n)
          product += static_cast<double>(bank.loop(band, a)[n]) * static_cast<double>(bank.loop(band, b)[n]);
        // Chance alone gives the lowest band, 180 Hz wide for a second, 1 / sqrt(2 * 180) = 0.05 rms.
        EXPECT_LT(std::abs(product) / energy_of(bank.loop(band, a)), 0.1) << band;
      }
    }
  }
}

TEST(Carriers, DependOnTheSeedAlone) {
  const BandLayout bands = BandLayout::octaves(16000.f);
  const CarrierBank one(bands, 16000.f, 1, 4096, 7), same(bands, 16000.f, 1, 4096, 7), other(bands, 16000.f, 1, 4096, 8),
      four(bands, 16000.f, 4, 4096, 7);
  const auto bits = [](const CarrierBank& bank, int band) {
    return std::vector<float>(bank.loop(band, 0).begin(), bank.loop(band, 0).end());
  };
  EXPECT_EQ(bits(one, 3), bits(same, 3));
  EXPECT_NE(bits(one, 3), bits(other, 3));
  EXPECT_EQ(bits(one, 3), bits(four, 3));  // the omnidirectional carrier is that of a mono response
}

}  // namespace
}  // namespace earshot
