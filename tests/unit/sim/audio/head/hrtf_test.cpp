// SPDX-License-Identifier: Apache-2.0
#include "sim/audio/head/hrtf.h"

#include <gtest/gtest.h>
#include <unistd.h>

#include <algorithm>
#include <cmath>
#include <cstdlib>
#include <fstream>
#include <numbers>

#include "sim/audio/head/ambisonics.h"
#include "sim/audio/head/rigid_sphere.h"
#include "sim/audio/transforms/fft.h"
#include "sim/base/errors.h"
#include "sim/base/files.h"
#include "sim/base/random.h"
#include "tests/support/acoustics/ears.h"
#include "tests/support/files/test_data.h"

namespace earshot {
namespace {

constexpr double kRadiusOverSpeedUs = 0.0875 / 343.0 * 1e6;

double level_db(std::complex<float> value) { return 20.0 * std::log10(std::abs(value)); }
double ild_db(const Ears& e, std::size_t bin) { return level_db(e.right[bin]) - level_db(e.left[bin]); }

/// Delay of the left ear behind the right one from the phase of one bin.
double itd_us(const Ears& e, std::size_t bin, double frequency_hz) {
  return std::arg(e.right[bin] * std::conj(e.left[bin])) / (2.0 * std::numbers::pi * frequency_hz) * 1e6;
}

// At 25.6 kHz bins are 50 Hz apart, so the frequencies of the tables fall on bins.
class RigidSphereHead : public ::testing::Test {
 protected:
  static void SetUpTestSuite() { head_ = Hrtf::rigid_sphere(25600.f); }
  static void TearDownTestSuite() { head_.reset(); }
  static std::shared_ptr<const Hrtf> head_;
};
std::shared_ptr<const Hrtf> RigidSphereHead::head_;

// docs/evidence/oracles.md, O-27: exact phase ITD at 200 Hz, ears at +-90 degrees.
TEST(RigidSphereSeries, HasTheExactTimeDifferenceAt200HzO27) {
  const double ka = 2.0 * std::numbers::pi * 200.0 / 343.0 * 0.0875;
  for (const auto& [azimuth_deg, expected_us] : {std::pair{10.0, 136.87}, {30.0, 392.91}, {60.0, 675.95}, {90.0, 777.96}}) {
    const double incidence[2] = {(90 + azimuth_deg) * kDegree, (90 - azimuth_deg) * kDegree};
    std::complex<double> pressure[2];
    rigid_sphere_pressure(ka, incidence, pressure);
    EXPECT_NEAR(std::arg(pressure[1] / pressure[0]) / (2.0 * std::numbers::pi * 200.0) * 1e6, expected_us, 0.01);
  }
}

// docs/evidence/oracles.md, O-27, ears at +-90 degrees: independent of the head's own +-100.
TEST(RigidSphereSeries, HasTheExactLevelDifferencesO27) {
  const double frequency_hz[] = {250, 500, 1000, 2000, 4000, 8000};
  const double expected_db[3][6] = {
      {0.1493, 1.52, 4.864, 4.398, 5.937, 7.898}, {0.2365, 1.847, 4.284, 9.993, 9.647, 12.86}, {0.2615, 1.798, 2.849, 3.905, 4.694, 6.078}};
  for (int a = 0; a < 3; ++a) {
    const double azimuth_deg = 30.0 * (a + 1);
    for (int f = 0; f < 6; ++f) {
      const double incidence[2] = {(90 + azimuth_deg) * kDegree, (90 - azimuth_deg) * kDegree};
      std::complex<double> pressure[2];
      rigid_sphere_pressure(2.0 * std::numbers::pi * frequency_hz[f] / 343.0 * 0.0875, incidence, pressure);
      EXPECT_NEAR(20.0 * std::log10(std::abs(pressure[1]) / std::abs(pressure[0])), expected_db[a][f],
                  6e-4 * std::max(1.0, expected_db[a][f]))
          << azimuth_deg << ' ' << frequency_hz[f];
    }
  }
}

TEST(RigidSphereSeries, HasItsLimits) {
  const double incidence[3] = {0.0, 1.0, std::numbers::pi};
  std::complex<double> pressure[3];
  rigid_sphere_pressure(0.0, incidence, pressure);
  for (const auto& value : pressure) EXPECT_EQ(value, 1.0);
  rigid_sphere_pressure(1e-4, incidence, pressure);  // 1 + 1.5 i ka cos(incidence)
  for (int i = 0; i < 3; ++i) {
    EXPECT_NEAR(pressure[i].real(), 1.0, 1e-7);
    EXPECT_NEAR(pressure[i].imag(), 1.5e-4 * std::cos(incidence[i]), 1e-9);
  }
  rigid_sphere_pressure(200.0, incidence, pressure);  // facing the source, a large sphere is a wall: pressure doubles
  EXPECT_NEAR(std::abs(pressure[0]), 2.0, 0.01);
  EXPECT_TRUE(std::isfinite(std::abs(pressure[2])));
}

TEST_F(RigidSphereHead, HasTheTableOfLevelDifferencesO27) {  // docs/evidence/oracles.md, O-27, ears at +-100 degrees
  const int bins[] = {5, 10, 20, 40, 80, 160};
  const double expected_db[3][6] = {{2.256e-4, 0.8982, 4.694, 5.309, 7.264, 9.6},
                                    {0.09622, 1.357, 3.206, 6.53, 15.12, 14.92},
                                    {0.2588, 1.807, 3.022, 4.681, 8.057, 21.57}};
  for (int a = 0; a < 3; ++a) {
    const Ears e = ears(*head_, from_right(30.0 * (a + 1)));
    for (int f = 0; f < 6; ++f)
      EXPECT_NEAR(ild_db(e, static_cast<std::size_t>(bins[f])), expected_db[a][f], 0.01) << 30 * (a + 1) << " bin " << bins[f];
  }
}

// The low-frequency ITD is 3/2 a/c times the difference of the cosines of incidence: ears at +-100 degrees have sin 100 of those at +-90.
TEST_F(RigidSphereHead, TimeDifferenceLiesBetweenItsLimitsO27) {
  for (const auto& [azimuth_deg, at_90_us] : {std::pair{10.0, 136.87}, {30.0, 392.91}, {60.0, 675.95}, {90.0, 777.96}})
    EXPECT_NEAR(itd_us(ears(*head_, from_right(azimuth_deg)), 4, 200.0), at_90_us * std::sin(100 * kDegree), 1.0);
  // High frequencies: slope of the interaural phase from 6 to 10 kHz against Woodworth's rays for these ears, within the ripple of the
  // creeping waves.
  for (const double azimuth_deg : {15.0, 30.0, 45.0, 60.0}) {
    const Ears e = ears(*head_, from_right(azimuth_deg));
    double turn = 0;
    for (std::size_t k = 120; k < 200; ++k) {
      const auto now = e.right[k + 1] * std::conj(e.left[k + 1]), before = e.right[k] * std::conj(e.left[k]);
      turn += std::arg(now * std::conj(before));
    }
    const double near_ear = 100 - azimuth_deg, far_ear = 100 + azimuth_deg;
    const double ray_us = kRadiusOverSpeedUs * ((far_ear - 90) * kDegree + std::cos(near_ear * kDegree));
    EXPECT_NEAR(turn / (2.0 * std::numbers::pi * 80 * 50.0) * 1e6, ray_us, 0.1 * ray_us) << azimuth_deg;
  }
}

TEST_F(RigidSphereHead, SourceOnTheRightIsEarlierAndLouderRightO27) {
  for (double azimuth_deg = 5; azimuth_deg < 180; azimuth_deg += 5) {
    const Ears e = ears(*head_, from_right(azimuth_deg, 10.0));
    EXPECT_GT(itd_us(e, 4, 200.0), 0) << azimuth_deg;
    double right = 0, left = 0;
    for (std::size_t k = 40; k <= 160; ++k) {
      right += std::norm(e.right[k]);
      left += std::norm(e.left[k]);
    }
    EXPECT_GT(right, left) << azimuth_deg;
  }
}

TEST_F(RigidSphereHead, MirroredSourceSwapsTheEarsExactlyO27) {
  for (const double azimuth_deg : {0.1, 17.0, 90.0, 133.3, 179.0}) {
    const glm::vec3 direction = from_right(azimuth_deg, 23.0);
    const Ears one = ears(*head_, direction), other = ears(*head_, {-direction.x, direction.y, direction.z});
    EXPECT_EQ(one.left, other.right);
    EXPECT_EQ(one.right, other.left);
  }
  for (double elevation_deg = -90; elevation_deg <= 270; elevation_deg += 15) {  // the median plane
    glm::vec3 direction = from_right(0, elevation_deg);
    direction.x = 0;
    const Ears e = ears(*head_, direction);
    EXPECT_EQ(e.left, e.right);
  }
}

TEST_F(RigidSphereHead, HasUnitGainAtLowFrequencies) {
  const Ears e = ears(*head_, from_right(70.0));
  EXPECT_NEAR(std::abs(e.left[0]), 1.0, 1e-6);
  EXPECT_NEAR(std::abs(e.right[0]), 1.0, 1e-6);
  EXPECT_NEAR(std::abs(e.right[1]), 1.0, 0.03);  // 50 Hz: ka = 0.08
}

TEST_F(RigidSphereHead, SpectraAreThePressureDelayedByTheLead) {
  const double azimuth_deg = 37.3;
  const Ears e = ears(*head_, from_right(azimuth_deg), 2.75);
  for (const std::size_t k : {1u, 20u, 100u, 200u}) {
    const double frequency_hz = 50.0 * static_cast<double>(k), incidence[1] = {(100 - azimuth_deg) * kDegree};
    std::complex<double> pressure[1];
    rigid_sphere_pressure(2.0 * std::numbers::pi * frequency_hz / 343.0 * 0.0875, incidence, pressure);
    const auto expected = pressure[0] * std::polar(1.0, -2.0 * std::numbers::pi * frequency_hz / 25600.0 * (head_->lead_samples() + 2.75));
    EXPECT_LT(std::abs(std::complex<double>(e.right[k]) - expected), 0.005) << k;  // interpolation between half degrees
  }
}

// H-57, H-59: no step when a source passes a grid direction, the pole, the ear axis or the +-180 degree seam.
TEST_F(RigidSphereHead, IsContinuousInDirection) {
  const auto expect_smooth = [&](auto&& direction_at, const char* path) {
    Ears before = ears(*head_, direction_at(0.0));
    for (double t = 0.1; t <= 360; t += 0.1) {
      const Ears now = ears(*head_, direction_at(t));
      for (const std::size_t k : {4u, 20u, 80u, 160u, 240u}) {
        // Physics: |d p / d angle| <= about ka = 0.08 k for k in bins, times 2 for the pressure on the lit side, per 0.1 degree.
        const double bound = (0.05 + 2.0 * 0.0802 * static_cast<double>(k)) * 0.1 * kDegree;
        ASSERT_LT(std::abs(now.left[k] - before.left[k]), bound) << path << ' ' << t << ' ' << k;
        ASSERT_LT(std::abs(now.right[k] - before.right[k]), bound) << path << ' ' << t << ' ' << k;
      }
      before = now;
    }
  };
  expect_smooth([](double t) { return from_right(t); }, "horizontal");
  expect_smooth([](double t) { return from_right(90.0, t); }, "over the ears");
  expect_smooth([](double t) { return from_right(0.0, t); }, "over the pole");
  expect_smooth([](double t) { return from_right(100.0, t - 180.0); }, "through the ear axis");
}

/// Spectrum of the decoder's ear for a first-order plane wave.
std::complex<double> decoded(const Hrtf& head, glm::vec3 direction, int ear, std::size_t bin) {
  float harmonics[4];
  spherical_harmonics_n3d(direction, 1, harmonics);
  std::complex<double> sum = 0;
  for (int c = 0; c < 4; ++c) sum += static_cast<double>(harmonics[c]) * std::complex<double>(head.diffuse_decoder(c, ear)[bin]);
  return sum;
}

struct DiffuseField {
  double left = 0, right = 0, coherence = 0;
};
DiffuseField diffuse_field(const Hrtf& head, std::size_t bin) {
  DiffuseField field;
  std::complex<double> cross = 0;
  for (int c = 0; c < 4; ++c) {
    const std::complex<double> left(head.diffuse_decoder(c, 0)[bin]), right(head.diffuse_decoder(c, 1)[bin]);
    field.left += std::norm(left);
    field.right += std::norm(right);
    cross += left * std::conj(right);
  }
  field.coherence = cross.real() / std::sqrt(field.left * field.right);
  return field;
}

TEST_F(RigidSphereHead, DiffuseFieldHasTheCoherenceOfAHeadO27) {  // docs/evidence/oracles.md, O-27
  for (const auto& [frequency_hz, expected] : {std::pair{250, 0.7636}, {500, 0.2037}, {1000, -0.1251}, {2000, -0.03115}, {4000, 0.003034}})
    EXPECT_NEAR(diffuse_field(*head_, static_cast<std::size_t>(frequency_hz / 50)).coherence, expected, 0.02) << frequency_hz;
  EXPECT_GT(diffuse_field(*head_, 1).coherence, 0.97);
}

TEST_F(RigidSphereHead, DiffuseFieldHasThePowerOfAHead) {
  for (const int bin : {2, 5, 10, 20, 40, 80, 160}) {
    // Mean of |p|^2 over incidence, by midpoints in the cosine: exact series, no code of the head.
    constexpr int count = 2000;
    std::vector<double> incidence(count);
    std::vector<std::complex<double>> pressure(count);
    for (int i = 0; i < count; ++i) incidence[i] = std::acos((2.0 * i + 1.0) / count - 1.0);
    rigid_sphere_pressure(2.0 * std::numbers::pi * 50.0 * bin / 343.0 * 0.0875, incidence, pressure);
    double expected = 0;
    for (const auto& value : pressure) expected += std::norm(value) / count;
    const DiffuseField field = diffuse_field(*head_, static_cast<std::size_t>(bin));
    EXPECT_NEAR(10.0 * std::log10(field.left / expected), 0.0, 0.1) << bin;
    EXPECT_NEAR(10.0 * std::log10(field.right / expected), 0.0, 0.1) << bin;
  }
}

TEST_F(RigidSphereHead, DecoderKeepsTheSideOfAPlaneWave) {
  const glm::vec3 right_side = from_right(60.0);
  const std::complex<double> low = decoded(*head_, right_side, 1, 4) * std::conj(decoded(*head_, right_side, 0, 4));
  EXPECT_NEAR(std::arg(low) / (2.0 * std::numbers::pi * 200.0) * 1e6, 666.0, 40.0);  // first order holds the phase below 600 Hz
  for (const std::size_t bin : {80u, 160u})
    EXPECT_GT(std::abs(decoded(*head_, right_side, 1, bin)), 1.5 * std::abs(decoded(*head_, right_side, 0, bin)));
  const glm::vec3 front = from_right(0.0);
  for (const std::size_t bin : {4u, 20u, 80u, 160u})
    EXPECT_NEAR(std::abs(decoded(*head_, front, 1, bin)) / std::abs(decoded(*head_, front, 0, bin)), 1.0, 0.01);
}

TEST_F(RigidSphereHead, DecoderIsCausalAndShort) {
  RealFft fft(head_->fft_size());
  std::vector<float> response(static_cast<std::size_t>(head_->fft_size()));
  for (int c = 0; c < 4; ++c) {
    for (int ear = 0; ear < 2; ++ear) {
      fft.inverse(head_->diffuse_decoder(c, ear), response);
      for (int i = head_->decoder_taps(); i < head_->fft_size(); ++i) ASSERT_NEAR(response[i], 0.f, 1e-6f);
    }
  }
  // The omnidirectional response arrives around the lead.
  fft.inverse(head_->diffuse_decoder(0, 0), response);
  const auto peak =
      std::max_element(response.begin(), response.end(), [](float a, float b) { return std::abs(a) < std::abs(b); }) - response.begin();
  EXPECT_NEAR(static_cast<double>(peak), head_->lead_samples(), 0.0005 * 25600);
}

TEST(Hrtf, RatesAgree) {
  const Ears at_16k = ears(*Hrtf::rigid_sphere(16000.f), from_right(50.0, 20.0)),
             at_48k = ears(*Hrtf::rigid_sphere(48000.f), from_right(50.0, 20.0));
  // 3 kHz: bin 96 of 31.25 Hz, bin 64 of 46.875 Hz.
  EXPECT_NEAR(level_db(at_16k.right[96]), level_db(at_48k.right[64]), 0.02);
  EXPECT_NEAR(level_db(at_16k.left[96]), level_db(at_48k.left[64]), 0.02);
  EXPECT_THROW(Hrtf::rigid_sphere(1000.f), InputError);
}

class KemarHead : public ::testing::Test {
 protected:
  void SetUp() override {
    SKIP_WITHOUT_DATA("hrtf/MIT_KEMAR_normal_pinna.sofa");
    path_ = data_folder() / "hrtf/MIT_KEMAR_normal_pinna.sofa";
  }
  std::filesystem::path path_;
};

/// Lag of the left ear behind the right one at the peak of their cross-correlation below 1.5 kHz, where both ears hear the same wave.
double correlation_itd_us(const Hrtf& head, glm::vec3 direction) {
  const Ears e = ears(head, direction);
  RealFft fine(16 * head.fft_size());  // sixteen-fold interpolation
  std::vector<std::complex<float>> cross(static_cast<std::size_t>(fine.num_bins()));
  for (std::size_t k = 1; k < e.left.size() && static_cast<double>(k) * head.sample_rate_hz() / head.fft_size() < 1500; ++k) {
    const auto product = e.left[k] * std::conj(e.right[k]);
    cross[k] = product / std::max(std::abs(product), 1e-12f);
  }
  std::vector<float> correlation(static_cast<std::size_t>(fine.size()));
  fine.inverse(cross, correlation);
  const auto peak = std::max_element(correlation.begin(), correlation.end()) - correlation.begin();
  const double lag = peak > fine.size() / 2 ? static_cast<double>(peak) - fine.size() : static_cast<double>(peak);
  return lag / 16.0 / head.sample_rate_hz() * 1e6;
}

TEST_F(KemarHead, HasTheCuesOfAHead) {
  for (const float rate : {16000.f, 44100.f}) {
    const auto head = Hrtf::from_sofa(path_, rate);
    EXPECT_NEAR(correlation_itd_us(*head, from_right(0.0)), 0.0, 30.0);
    const double right_us = correlation_itd_us(*head, from_right(90.0));
    EXPECT_GT(right_us, 600.0);  // a human head: 600 to 800 us
    EXPECT_LT(right_us, 800.0);
    EXPECT_NEAR(correlation_itd_us(*head, from_right(-90.0)), -right_us, 30.0);
    const Ears right = ears(*head, from_right(70.0)), left = ears(*head, from_right(-70.0));
    const auto bin = [&](double frequency_hz) { return static_cast<std::size_t>(std::lround(frequency_hz * head->fft_size() / rate)); };
    for (const double frequency_hz : {1000.0, 2000.0, 4000.0, 6000.0}) {
      EXPECT_GT(ild_db(right, bin(frequency_hz)), 3.0) << frequency_hz;
      EXPECT_LT(ild_db(left, bin(frequency_hz)), -3.0) << frequency_hz;
    }
    EXPECT_LT(std::abs(ild_db(right, bin(200.0))), 6.0);
  }
}

TEST_F(KemarHead, TimeZeroIsTheCentreOfTheHead) {
  // Each ear is early or late by half the ITD: the mean delay over both is small once the lead is taken off.
  const auto head = Hrtf::from_sofa(path_, 44100.f);
  for (const double azimuth_deg : {0.0, 90.0, 180.0}) {
    const Ears e = ears(*head, from_right(azimuth_deg));
    double turn[2] = {0, 0};
    for (std::size_t k = 10; k < 20; ++k) {
      turn[0] += std::arg(e.left[k + 1] * std::conj(e.left[k]));
      turn[1] += std::arg(e.right[k + 1] * std::conj(e.right[k]));
    }
    const double group_delay = -(turn[0] + turn[1]) / 2.0 / 10.0 * head->fft_size() / (2.0 * std::numbers::pi);
    EXPECT_NEAR(group_delay - head->lead_samples(), 0.0, 0.0006 * 44100) << azimuth_deg;  // canal resonance and loudspeaker delay included
  }
}

TEST_F(KemarHead, IsContinuousInDirection) {
  const auto head = Hrtf::from_sofa(path_, 16000.f);
  // A step of the interpolation would not shrink with the distance; a slope does.
  const auto largest_change = [&](double step_deg) {
    double largest = 0;
    for (double azimuth_deg = 0; azimuth_deg < 360; azimuth_deg += 1.7) {
      const Ears a = ears(*head, from_right(azimuth_deg, 93 * std::sin(azimuth_deg))),
                 b = ears(*head, from_right(azimuth_deg + step_deg, 93 * std::sin(azimuth_deg)));
      double change = 0, power = 0;
      for (std::size_t k = 0; k < a.left.size(); ++k) {
        change += std::norm(a.left[k] - b.left[k]);
        power += std::norm(a.left[k]);
      }
      largest = std::max(largest, std::sqrt(change / power));
    }
    return largest;
  };
  EXPECT_LT(largest_change(0.2), 0.15);
  EXPECT_LT(largest_change(0.002), 0.003);
}

TEST_F(KemarHead, DecoderHasTheDiffusePowerOfTheSphere) {
  const auto head = Hrtf::from_sofa(path_, 16000.f), sphere = Hrtf::rigid_sphere(16000.f);
  double measured = 0, ideal = 0;
  for (std::size_t k = 8; k <= 128; ++k) {  // 250 Hz to 4 kHz
    measured += diffuse_field(*head, k).left + diffuse_field(*head, k).right;
    ideal += diffuse_field(*sphere, k).left + diffuse_field(*sphere, k).right;
  }
  EXPECT_NEAR(10.0 * std::log10(measured / ideal), 0.0, 0.3);
}

TEST_F(KemarHead, DamagedFilesAreRefused) {
  const std::string whole = read_file(path_);
  const auto file = std::filesystem::temp_directory_path() / ("earshot_hrtf_test_" + std::to_string(::getpid()) + ".sofa");
  const auto write = [&](const std::string& bytes) { std::ofstream(file, std::ios::binary) << bytes; };
  for (const double fraction : {0.0, 1e-5, 0.001, 0.1, 0.5, 0.9}) {
    write(whole.substr(0, static_cast<std::size_t>(fraction * static_cast<double>(whole.size()))));
    EXPECT_THROW(Hrtf::from_sofa(file, 16000.f), InputError) << fraction;
  }
  write("this is not HDF5");
  EXPECT_THROW(Hrtf::from_sofa(file, 16000.f), InputError);
  std::filesystem::remove(file);
}

TEST(Hrtf, MissingFileIsRefused) {
  try {
    Hrtf::from_sofa("/nowhere/head.sofa", 16000.f);
    ADD_FAILURE() << "accepted";
  } catch (const InputError& error) {
    EXPECT_NE(std::string(error.what()).find("/nowhere/head.sofa"), std::string::npos);
  }
  EXPECT_THROW(Hrtf::from_sofa(std::filesystem::temp_directory_path(), 16000.f), InputError);
}

}  // namespace
}  // namespace earshot
