// SPDX-License-Identifier: Apache-2.0
#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <utility>

#include "sim/audio/head/head_grid.h"
#include "sim/audio/head/hrtf.h"
#include "sim/audio/head/sofa_reader.h"
#include "sim/audio/measured/direction_weights.h"
#include "sim/audio/measured/ear_order.h"
#include "sim/audio/measured/measured_spheres.h"
#include "sim/audio/measured/node_grid.h"
#include "sim/audio/measured/response_parts.h"
#include "sim/audio/transforms/fft.h"
#include "sim/base/errors.h"
#include "sim/base/text/log.h"

namespace earshot {
namespace {

using Complex = std::complex<float>;

/// Mean power of both ears from 250 Hz to 4 kHz.  Measured heads, whose scale is arbitrary, are brought to that of the rigid sphere.
double mean_power(std::span<const Complex> left, std::span<const Complex> right, double bin_hz) {
  double sum = 0, count = 0;
  for (std::size_t k = 0; k < left.size(); ++k) {
    const double frequency_hz = static_cast<double>(k) * bin_hz;
    if (frequency_hz < 250 || frequency_hz > 4000) continue;
    sum += 0.5 * (std::norm(left[k]) + std::norm(right[k]));
    count += 1;
  }
  return sum / std::max(count, 1.0);
}

/// Up to where magnitudes of the measurement count: those above the band of the simulation have a part in its phases.
double band_for(float sample_rate_hz) { return std::max(24000.0, 0.5 * static_cast<double>(sample_rate_hz)); }

/// A rate that is wrong in the file, or rooms instead of heads: every response costs a sum over its samples for each bin, every sphere a
/// grid.
void check_work(const SofaResponses& sofa, std::size_t num_spheres, float sample_rate_hz, int fft_size, const std::string& where) {
  const double bin_hz = static_cast<double>(sample_rate_hz) / fft_size;
  const double bins = std::min(band_for(sample_rate_hz), 0.5 * static_cast<double>(sofa.sample_rate_hz)) / bin_hz;
  const double rows = 2.0 * static_cast<double>(sofa.direction.size());
  const double nodes = 2.0 * static_cast<double>(NodeGrid::num_nodes() * num_spheres);
  const double tables_bytes = 2.0 * sizeof(float) * sofa.num_taps * bins;
  if ((rows + nodes) * std::max(bins, 0.5 * fft_size) * sizeof(Complex) + tables_bytes > 4e9 || rows * sofa.num_taps * bins > 1e11)
    throw InputError(where,
                     fmt::format("has {:.0f} responses of {} samples at {} Hz from {} distances, which is too much at {} Hz", rows,
                                 sofa.num_taps, sofa.sample_rate_hz, num_spheres, sample_rate_hz),
                     "check Data.SamplingRate, or shorten the responses");
}

/// Parts of the responses of a sphere, [direction][ear]: of each direction the mean of its copies.
std::vector<ResponseParts> divide_sphere(const SofaResponses& sofa, const MeasuredSphere& sphere, ResponseDivider& divider) {
  const auto taps = static_cast<std::size_t>(sofa.num_taps);
  std::vector<ResponseParts> parts;
  for (const MeasuredDirection& one_direction : sphere.directions) {
    const std::vector<std::size_t>& copies = one_direction.copies;
    for (std::size_t ear = 0; ear < 2; ++ear) {
      ResponseParts mean = divider.empty();
      for (const std::size_t m : copies) {
        const std::size_t row = 2 * m + ear;
        ResponseParts row_parts = divider.divide(std::span(sofa.taps).subspan(row * taps, taps));
        row_parts.delay_s += static_cast<double>(sofa.delay_samples[row]) / static_cast<double>(sofa.sample_rate_hz);
        mean.add(row_parts, 1.f / static_cast<float>(copies.size()));
      }
      parts.push_back(std::move(mean));
    }
  }
  return parts;
}

/// The grid of one sphere: magnitudes, delays and phases interpolated apart from each other to each node.
HeadGrid make_grid(const SofaResponses& sofa, const MeasuredSphere& sphere, float sample_rate_hz, int fft_size, ResponseDivider& divider) {
  const std::vector<ResponseParts> parts = divide_sphere(sofa, sphere, divider);
  std::vector<glm::vec3> directions;
  for (const MeasuredDirection& measured : sphere.directions) directions.push_back(measured.direction);
  const DirectionWeights weights(directions);
  HeadGrid grid;
  grid.fft_size = fft_size;
  grid.num_bins = static_cast<std::size_t>(fft_size / 2 + 1);
  if (sphere.distance_m > 0) grid.distance_m = sphere.distance_m;
  grid.aligned.resize(2 * NodeGrid::num_nodes() * grid.num_bins);
  grid.delay_samples.resize(2 * NodeGrid::num_nodes());
  const ResponseParts zero = divider.empty();
  ResponseParts sum = zero;
  for (std::size_t node = 0; node < NodeGrid::num_nodes(); ++node) {
    const std::vector<DirectionWeights::Weight> of_node = weights.at(NodeGrid::direction(node));
    for (std::size_t ear = 0; ear < 2; ++ear) {
      sum = zero;
      for (const auto& [number, weight] : of_node) sum.add(parts[2 * number + ear], static_cast<float>(weight));
      const std::size_t row = 2 * node + ear;
      divider.join(sum, std::span(grid.aligned).subspan(row * grid.num_bins, grid.num_bins));
      grid.delay_samples[row] = sum.delay_s * static_cast<double>(sample_rate_hz);
    }
  }
  return grid;
}

/// Time zero is the head's centre, level that of the rigid sphere at the same distance: both from means over evenly spread directions.
void bring_to_sphere(HeadGrid& grid, const Hrtf& sphere, const std::string& where) {
  const double bin_hz = static_cast<double>(sphere.sample_rate_hz()) / grid.fft_size;
  const double sphere_bin_hz = static_cast<double>(sphere.sample_rate_hz()) / sphere.fft_size();
  std::vector<Complex> left(grid.num_bins), right(grid.num_bins), sphere_left(static_cast<std::size_t>(sphere.fft_size() / 2 + 1)),
      sphere_right(sphere_left.size());
  double late = 0, power = 0, sphere_power = 0;
  for (int i = 0; i < kMeanDirections; ++i) {
    const glm::vec3 towards = mean_direction(i);
    std::array<double, 2> delay{};
    grid.write_aligned(towards, 1.f, false, delay, left, right);
    const std::array<double, 2> wanted = sphere.aligned_spectra(towards, sphere_left, sphere_right, grid.distance_m);
    late += 0.5 * (delay[0] + delay[1] - wanted[0] - wanted[1]) / kMeanDirections;
    power += mean_power(left, right, bin_hz);
    sphere_power += mean_power(sphere_left, sphere_right, sphere_bin_hz);
  }
  if (!(power > 0))
    throw InputError(where, "has no energy between 250 Hz and 4 kHz in Data.IR", "use a file with head-related impulse responses");
  for (double& value : grid.delay_samples) value -= late;
  const auto gain = static_cast<float>(std::sqrt(sphere_power / power));
  for (Complex& value : grid.aligned) value *= gain;
}

}  // namespace

std::shared_ptr<const Hrtf> Hrtf::from_sofa(const std::filesystem::path& path, float sample_rate_hz) {
  check_rate(sample_rate_hz);
  return from_responses(read_sofa(path), sample_rate_hz, path.string());
}

std::shared_ptr<const Hrtf> Hrtf::from_responses(const SofaResponses& sofa, float sample_rate_hz, const std::string& where) {
  check_rate(sample_rate_hz);
  validate(sofa, where);
  const EarEvidence evidence = weigh_ears(sofa.direction, sofa.taps, sofa.num_taps, sofa.delay_samples, sofa.sample_rate_hz);
  if (evidence.first_is_left() < 0)
    log_warning(
        fmt::format("{}: a source on the left is {:.1f} dB louder and {:.0f} us earlier at the right ear; check whether SourcePosition "
                    "counts azimuths clockwise, or the ears are swapped",
                    where, -evidence.level_db, -1e6 * evidence.early_s));
  const double ratio = static_cast<double>(sample_rate_hz) / static_cast<double>(sofa.sample_rate_hz);
  const int length = static_cast<int>(std::ceil(static_cast<double>(sofa.num_taps) * ratio)) + 2 * lead_for(sample_rate_hz);
  const int fft_size = std::max(smallest_fft_for(sample_rate_hz), next_power_of_two(length));
  const std::vector<float> unknown(sofa.distance_m.empty() ? sofa.direction.size() : 0, 0.f);
  const std::vector<MeasuredSphere> spheres = sort_into_spheres(sofa.direction, sofa.distance_m.empty() ? unknown : sofa.distance_m);
  check_work(sofa, spheres.size(), sample_rate_hz, fft_size, where);
  ResponseDivider divider(static_cast<std::size_t>(sofa.num_taps), static_cast<double>(sofa.sample_rate_hz),
                          static_cast<double>(sample_rate_hz) / fft_size, band_for(sample_rate_hz));
  const auto sphere = rigid_sphere(sample_rate_hz);
  std::vector<HeadGrid> grids;
  for (const MeasuredSphere& measured : spheres) {
    grids.push_back(make_grid(sofa, measured, sample_rate_hz, fft_size, divider));
    bring_to_sphere(grids.back(), *sphere, where);
  }
  return std::shared_ptr<const Hrtf>(new Hrtf(sample_rate_hz, std::move(grids)));
}

}  // namespace earshot
