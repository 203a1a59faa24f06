// SPDX-License-Identifier: Apache-2.0
#include "sim/audio/head/head_grid.h"

#include <algorithm>
#include <cmath>
#include <glm/geometric.hpp>
#include <numbers>
#include <utility>

#include "sim/audio/head/rigid_sphere.h"
#include "sim/audio/measured/node_grid.h"
#include "sim/audio/transforms/fft.h"
#include "sim/audio/transforms/spectrum_math.h"

namespace earshot {
namespace {

constexpr double kEarAngle = 100.0 * std::numbers::pi / 180.0;

}  // namespace

int lead_for(float sample_rate_hz) { return static_cast<int>(std::ceil(0.002 * sample_rate_hz)); }
int smallest_fft_for(float sample_rate_hz) { return next_power_of_two(static_cast<int>(std::ceil(0.02 * sample_rate_hz))); }

glm::vec3 mean_direction(int number) {
  const double height = (2.0 * number + 1.0) / kMeanDirections - 1.0, radius = std::sqrt(1.0 - height * height);
  const double angle = 2.0 * std::numbers::pi * std::fmod(number * std::numbers::phi, 1.0);
  return {radius * std::cos(angle), height, radius * std::sin(angle)};
}

double cosine_at_ear(glm::dvec3 towards, int ear) {
  const double side = ear == 0 ? -std::sin(kEarAngle) : std::sin(kEarAngle);
  return towards.x * side + towards.z * -std::cos(kEarAngle);
}

HeadGrid::Blend HeadGrid::blend_sphere(glm::dvec3 towards, int ear) const {
  const double position = std::acos(std::clamp(cosine_at_ear(towards, ear), -1.0, 1.0)) / std::numbers::pi * intervals;
  const auto row = static_cast<std::size_t>(std::min(position, intervals - 1.0));
  const auto weight = static_cast<float>(position - static_cast<double>(row));
  return {.count = 2, .row = {row, row + 1}, .weight = {1.f - weight, weight}};
}

/// Rows of the left ear; the right one follows each.
HeadGrid::Blend HeadGrid::blend_nodes(glm::dvec3 towards) {
  Blend blend{.count = kMaxRows};
  const NodeGrid::Place place = NodeGrid::find(towards);
  for (std::size_t i = 0; i < kMaxRows; ++i) {
    blend.row[i] = 2 * place.node[i];
    blend.weight[i] = place.weight[i];
  }
  return blend;
}

/// Returns `delay` with the delay of the rows added.
double HeadGrid::write_rows(const Blend& blend, float fraction, bool add, double delay, std::span<std::complex<float>> out) const {
  std::complex<float>* sum = out.data();
  for (std::size_t n = 0; n < blend.count; ++n) {
    const std::complex<float>* row = aligned.data() + blend.row[n] * num_bins;
    const float weight = fraction * blend.weight[n];
    delay += weight * delay_samples[blend.row[n]];
    if (n == 0 && !add)
      for (std::size_t k = 0; k < num_bins; ++k) sum[k] = weight * row[k];
    else
      for (std::size_t k = 0; k < num_bins; ++k) sum[k] += weight * row[k];
  }
  return delay;
}

void HeadGrid::write_aligned(glm::vec3 towards, float fraction, bool add, std::array<double, 2>& delay, std::span<std::complex<float>> left,
                             std::span<std::complex<float>> right) const {
  if (!add) delay = {0.0, 0.0};
  if (intervals > 0) {
    delay[0] = write_rows(blend_sphere(towards, 0), fraction, add, delay[0], left);
    delay[1] = write_rows(blend_sphere(towards, 1), fraction, add, delay[1], right);
    return;
  }
  Blend blend = blend_nodes(towards);
  delay[0] = write_rows(blend, fraction, add, delay[0], left);
  for (std::size_t& row : blend.row) ++row;
  delay[1] = write_rows(blend, fraction, add, delay[1], right);
}

void HeadGrid::write(glm::vec3 towards, std::span<std::complex<float>> left, std::span<std::complex<float>> right) const {
  std::array<double, 2> delay{};
  write_aligned(towards, 1.f, false, delay, left, right);
  delay_spectrum(left.first(num_bins), delay[0], fft_size);
  delay_spectrum(right.first(num_bins), delay[1], fft_size);
}

HeadGrid HeadGrid::rigid_sphere(float sample_rate_hz) {
  HeadGrid grid;
  grid.fft_size = smallest_fft_for(sample_rate_hz);
  grid.num_bins = static_cast<std::size_t>(grid.fft_size / 2 + 1);
  // The pattern behind the head repeats every pi / ka; sixteen rows or more to a period keep linear interpolation below 0.05 dB.
  const double ka_per_hz = 2.0 * std::numbers::pi * kHeadRadiusM / kHeadSpeedOfSoundMPerS;
  const int rows_per_degree = std::max(2, static_cast<int>(std::ceil(16.0 * ka_per_hz * 0.5 * sample_rate_hz / 180.0)));
  grid.intervals = 180 * rows_per_degree;
  const auto rows = static_cast<std::size_t>(grid.intervals) + 1;
  std::vector<double> incidence(rows);
  for (std::size_t row = 0; row < rows; ++row) {
    incidence[row] = std::numbers::pi * static_cast<double>(row) / grid.intervals;
    grid.delay_samples.push_back(rigid_sphere_delay(incidence[row]) * kHeadRadiusM / kHeadSpeedOfSoundMPerS * sample_rate_hz);
  }
  grid.aligned.resize(rows * grid.num_bins);
  std::vector<std::complex<double>> pressure(rows);
  for (std::size_t k = 0; k < grid.num_bins; ++k) {
    const double frequency_hz = static_cast<double>(k) * sample_rate_hz / grid.fft_size;
    rigid_sphere_pressure(ka_per_hz * frequency_hz, incidence, pressure);
    for (std::size_t row = 0; row < rows; ++row) {
      const double advance = 2.0 * std::numbers::pi * static_cast<double>(k) * grid.delay_samples[row] / grid.fft_size;
      grid.aligned[row * grid.num_bins + k] = std::complex<float>(pressure[row] * std::polar(1.0, advance));
    }
  }
  return grid;
}

}  // namespace earshot
