// SPDX-License-Identifier: Apache-2.0
// Heads between their measurements: each direction of two heads is left out and made from the others.
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <complex>
#include <numbers>
#include <vector>

#include "sim/audio/measured/direction_weights.h"
#include "sim/audio/measured/node_grid.h"
#include "sim/audio/measured/response_parts.h"
#include "sim/base/random.h"
#include "tests/support/acoustics/measured_heads.h"

namespace earshot {
namespace {

constexpr double kBinHz = 31.25;

/// Levels per third octave of parts, in dB.
std::vector<double> levels_of(const ResponseParts& parts) {
  std::vector<double> levels;
  const double half = std::pow(2.0, 1.0 / 6.0);
  for (const double centre : third_octaves()) {
    double power = 0;
    int count = 0;
    for (auto k = static_cast<std::size_t>(std::ceil(centre / half / kBinHz)); static_cast<double>(k) * kBinHz < centre * half; ++k) {
      power += std::exp(2.0 * static_cast<double>(parts.log_magnitude.at(k)));
      ++count;
    }
    levels.push_back(10.0 * std::log10(power / count));
  }
  return levels;
}

/// Lead of the left ear, from the interaural phases between 250 Hz and 1.5 kHz by least squares.
double low_lead_s(ResponseDivider& divider, const ResponseParts& left, const ResponseParts& right) {
  std::vector<std::complex<float>> a(divider.num_bins()), b(a.size());
  divider.join(left, a);
  divider.join(right, b);
  double sum = 0, weight = 0;
  for (std::size_t k = 8; static_cast<double>(k) * kBinHz < 1500; ++k) {
    const double omega = 2 * std::numbers::pi * static_cast<double>(k) * kBinHz;
    sum += omega * (omega * (right.delay_s - left.delay_s) - static_cast<double>(std::arg(b[k] * std::conj(a[k]))));
    weight += omega * omega;
  }
  return sum / weight;
}

struct LeftOut {
  std::vector<double> sum_of_squares_db;  ///< [third octave], over directions and ears
  double worst_beyond_neighbour_db = -100, sum_of_squares_us = 0, worst_us = 0;
  int num_beyond_neighbour = 0, num_late = 0, count = 0;
};

double root_mean_square(const std::vector<double>& a, const std::vector<double>& b) {
  double sum = 0;
  for (std::size_t i = 0; i < a.size(); ++i) sum += (a[i] - b[i]) * (a[i] - b[i]);
  return std::sqrt(sum / static_cast<double>(a.size()));
}

LeftOut leave_out_each(const std::string& name) {
  const HeadData head = read_head(name);
  ResponseDivider divider(head.taps, head.rate_hz, kBinHz, 24000);
  std::vector<ResponseParts> parts;
  std::vector<std::vector<double>> levels;
  for (std::size_t row = 0; row < 2 * head.direction.size(); ++row) {
    parts.push_back(divider.divide(std::span(head.samples).subspan(row * head.taps, head.taps)));
    levels.push_back(levels_of(parts.back()));
  }
  LeftOut result{.sum_of_squares_db = std::vector<double>(third_octaves().size())};
  for (std::size_t i = 0; i < head.direction.size(); ++i) {
    std::vector<glm::vec3> others = head.direction;
    others.erase(others.begin() + static_cast<std::ptrdiff_t>(i));
    const auto weights = DirectionWeights(others).at(head.direction[i]);  // the nearest first
    std::vector<ResponseParts> made(2, divider.empty());
    double error_db = 0, neighbours_db[2] = {0, 0};
    for (std::size_t ear = 0; ear < 2; ++ear) {
      for (const auto& [other, weight] : weights)
        made[ear].add(parts[2 * (other < i ? other : other + 1) + ear], static_cast<float>(weight));
      const std::vector<double> interpolated = levels_of(made[ear]);
      const std::vector<double>& truth = levels[2 * i + ear];
      for (std::size_t b = 0; b < truth.size(); ++b) result.sum_of_squares_db[b] += std::pow(interpolated[b] - truth[b], 2);
      error_db = std::hypot(error_db, root_mean_square(interpolated, truth) / std::numbers::sqrt2);
      for (std::size_t n = 0; n < 2; ++n) {
        const std::size_t other = weights[n].direction < i ? weights[n].direction : weights[n].direction + 1;
        neighbours_db[n] = std::hypot(neighbours_db[n], root_mean_square(levels[2 * other + ear], truth) / std::numbers::sqrt2);
      }
    }
    const double beyond_db = error_db - std::min(neighbours_db[0], neighbours_db[1]);
    result.worst_beyond_neighbour_db = std::max(result.worst_beyond_neighbour_db, beyond_db);
    result.num_beyond_neighbour += beyond_db > 1 ? 1 : 0;
    const double late_us = 1e6 * (low_lead_s(divider, made[0], made[1]) - low_lead_s(divider, parts[2 * i], parts[2 * i + 1]));
    result.sum_of_squares_us += late_us * late_us;
    result.worst_us = std::max(result.worst_us, std::abs(late_us));
    result.num_late += std::abs(late_us) > 10 ? 1 : 0;
    ++result.count;
  }
  return result;
}

void print(const std::string& name, const LeftOut& result) {
  std::printf("%s, %d directions: dB per third octave from 250 Hz", name.c_str(), result.count);
  for (const double sum : result.sum_of_squares_db) std::printf(" %.2f", std::sqrt(sum / (2 * result.count)));
  std::printf("; worst beyond the better neighbour %.2f dB, %d beyond 1 dB; time differences %.1f us, worst %.1f, %d beyond 10\n",
              result.worst_beyond_neighbour_db, result.num_beyond_neighbour, std::sqrt(result.sum_of_squares_us / result.count),
              result.worst_us, result.num_late);
}

TEST(HeadInterpolation, DirectionsLeftOutAreMadeFromTheOthers) {
  SKIP_WITHOUT_DATA("hrtf/sadie_subject002_48k.json");
  const LeftOut kemar = leave_out_each("mit_kemar_normal_44k1"), sadie = leave_out_each("sadie_subject002_48k");
  print("KEMAR", kemar);
  print("SADIE 2", sadie);
  const std::vector<double> centres = third_octaves();
  for (std::size_t b = 0; b < centres.size(); ++b) {
    const double both = std::sqrt((kemar.sum_of_squares_db[b] + sadie.sum_of_squares_db[b]) / (2.0 * (kemar.count + sadie.count)));
    // At 8 kHz, where notches move with the direction, it falls short of 1 dB (docs/howto/heads.md).
    EXPECT_LT(both, centres[b] < 7000 ? 1.0 : centres[b] < 9000 ? 1.25 : 2.0) << centres[b];
  }
  EXPECT_EQ(kemar.num_beyond_neighbour, 0);
  // One measurement of this head, at azimuth 225 and elevation -50 degrees, differs by 13 dB and 0.25 ms from those about it.
  EXPECT_LE(sadie.num_beyond_neighbour, 4);
  EXPECT_LE(kemar.num_late, 5);
  EXPECT_LT(std::sqrt(kemar.sum_of_squares_us / kemar.count), 3.0);  // SADIE: its faulty measurement alone makes more
}

// Weights add up to one; a measured direction is itself, and a copy of it would not change that.
TEST(HeadInterpolation, MeasuredDirectionsAreKept) {
  std::vector<glm::vec3> directions;
  for (std::uint32_t i = 0; i < 60; ++i) {
    const auto u = RandomStream(5, Purpose::test).uniform2(i);
    const double height = 2.0 * static_cast<double>(u[0]) - 1.0, angle = 2.0 * std::numbers::pi * static_cast<double>(u[1]);
    const double radius = std::sqrt(1.0 - height * height);
    directions.emplace_back(radius * std::cos(angle), height, radius * std::sin(angle));
  }
  const DirectionWeights weights(directions);
  for (std::size_t i = 0; i < directions.size(); ++i) {
    double sum = 0;
    for (const auto& [number, weight] : weights.at(directions[i])) {
      EXPECT_NEAR(weight, number == i ? 1.0 : 0.0, 1e-6) << i;
      sum += weight;
    }
    EXPECT_NEAR(sum, 1.0, 1e-9);
  }
}

// 1 / (1 - a z^-1) with a = 0.6 has its zeros and poles inside the unit circle, so its phase is the least one of its magnitudes: what is
// left is the delay of 67 samples.  0.6^189 of the response is cut off.
TEST(HeadInterpolation, ResponsesComeApartInClosedForm) {
  constexpr double rate_hz = 48000, bin_hz = rate_hz / 1024, a = 0.6;  // whole: no magnitudes beyond the band to be guessed
  constexpr std::size_t delay = 67;
  std::vector<float> response(256, 0.f);
  for (std::size_t n = delay; n < response.size(); ++n) response[n] = static_cast<float>(std::pow(a, static_cast<double>(n - delay)));
  ResponseDivider divider(response.size(), rate_hz, bin_hz, 24000);
  const ResponseParts parts = divider.divide(response);
  EXPECT_NEAR(parts.delay_s * rate_hz, static_cast<double>(delay), 1e-3);
  std::vector<std::complex<float>> spectrum(divider.num_bins());
  divider.join(parts, spectrum);
  double largest = 0;
  for (std::size_t k = 0; k < spectrum.size(); ++k) {
    const std::complex<double> turn = std::polar(1.0, -2 * std::numbers::pi * static_cast<double>(k) * bin_hz / rate_hz);
    largest = std::max(largest, std::abs(std::complex<double>(spectrum[k]) * (1.0 - a * turn) - 1.0));
  }
  EXPECT_LT(largest, 1e-3);
}

// Four nodes about each direction, with the weights of a mean; a node is itself.
TEST(HeadInterpolation, NodesCoverTheSphere) {
  for (std::uint32_t i = 0; i < 2000; ++i) {
    const auto u = RandomStream(6, Purpose::test).uniform2(i);
    const double height = 2.0 * static_cast<double>(u[0]) - 1.0, angle = 2.0 * std::numbers::pi * static_cast<double>(u[1]);
    const double radius = std::sqrt(1.0 - height * height);
    const glm::dvec3 towards(radius * std::cos(angle), height, radius * std::sin(angle));
    const NodeGrid::Place place = NodeGrid::find(towards);
    glm::dvec3 mean(0);
    float sum = 0;
    for (std::size_t n = 0; n < 4; ++n) {
      ASSERT_LT(place.node[n], NodeGrid::num_nodes());
      ASSERT_GE(place.weight[n], 0.f);
      sum += place.weight[n];
      mean += static_cast<double>(place.weight[n]) * glm::dvec3(NodeGrid::direction(place.node[n]));
    }
    EXPECT_NEAR(sum, 1.f, 1e-6f);
    // The arrow of the widest arc: beside a pole a row of 2.5 degrees has seven nodes, 0.0436 (1 - cos 25.7 degrees).
    EXPECT_LT(glm::length(mean - towards), 0.005);
  }
  for (std::size_t node = 0; node < NodeGrid::num_nodes(); node += 37) {
    const NodeGrid::Place place = NodeGrid::find(glm::dvec3(NodeGrid::direction(node)));
    double own_error = 0;
    for (std::size_t n = 0; n < 4; ++n) own_error += place.node[n] == node ? static_cast<double>(place.weight[n]) : 0.0;
    EXPECT_NEAR(own_error, 1.0, 1e-4) << node;
  }
}

}  // namespace
}  // namespace earshot
