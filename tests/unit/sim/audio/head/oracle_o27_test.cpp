// SPDX-License-Identifier: Apache-2.0
#include <gtest/gtest.h>

#include <array>
#include <cmath>
#include <numbers>
#include <vector>

#include "sim/audio/head/hrtf.h"
#include "sim/audio/head/rigid_sphere.h"
#include "tests/support/acoustics/directions.h"

namespace earshot {
namespace {

constexpr double kUsPerRadius = kHeadRadiusM / kHeadSpeedOfSoundMPerS * 1e6;

struct Row {
  double azimuth_deg, us;
};

// (a / c) (theta + sin theta), ears at +-90 degrees, source on the right.  The table has five digits.
TEST(OracleO27, FirstWaveFrontsHaveWoodworthsDifference) {
  for (const Row& row :
       {Row{0, 0}, {5, 44.495}, {10, 88.822}, {15, 132.81}, {30, 261.12}, {45, 380.74}, {60, 488.07}, {75, 580.34}, {90, 655.82}}) {
    const double left = rigid_sphere_delay((90 + row.azimuth_deg) * kDegree), right = rigid_sphere_delay((90 - row.azimuth_deg) * kDegree);
    EXPECT_NEAR((left - right) * kUsPerRadius, row.us, 0.006) << row.azimuth_deg;
  }
}

// 3 (a / c) sin theta: the phase difference far below ka = 1.
TEST(OracleO27, LowFrequencyLimitOfThePhaseDifference) {
  const double ka = 1e-3;
  for (const Row& row : {Row{0, 0}, {10, 132.89}, {30, 382.65}, {45, 541.15}, {60, 662.77}, {90, 765.31}}) {
    const std::array<double, 2> incidence = {(90 + row.azimuth_deg) * kDegree, (90 - row.azimuth_deg) * kDegree};
    std::array<std::complex<double>, 2> pressure;
    rigid_sphere_pressure(ka, incidence, pressure);
    const double lead_rad = std::arg(pressure[1] * std::conj(pressure[0]));
    EXPECT_NEAR(lead_rad / ka * kUsPerRadius, row.us, 0.01) << row.azimuth_deg;
  }
}

// Median plane of a symmetric head: no difference in time or level, in front, above and behind.
TEST(OracleO27, MedianPlaneHasNoDifferences) {
  const auto head = Hrtf::rigid_sphere(16000.f);
  std::vector<std::complex<float>> left(static_cast<std::size_t>(head->fft_size() / 2 + 1)), right(left.size());
  for (double angle_deg = 0; angle_deg < 360; angle_deg += 7.5) {
    const glm::vec3 direction(0, std::sin(angle_deg * kDegree), -std::cos(angle_deg * kDegree));
    head->spectra(direction, left, right, 0.37);
    for (std::size_t k = 0; k < left.size(); ++k) ASSERT_LT(std::abs(left[k] - right[k]), 1e-6f) << angle_deg;
  }
}

}  // namespace
}  // namespace earshot
