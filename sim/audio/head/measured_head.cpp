#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <limits>
#include <numbers>
#include <utility>

#include "sim/audio/head/head_grid.h"
#include "sim/audio/head/hrtf.h"
#include "sim/audio/head/sofa_reader.h"
#include "sim/audio/measured/ear_order.h"
#include "sim/audio/measured/measured_spheres.h"
#include "sim/audio/transforms/fft.h"
#include "sim/audio/transforms/spectrum_math.h"
#include "sim/base/errors.h"
#include "sim/base/text/log.h"

namespace earshot {
namespace {

using Complex = std::complex<float>;

/// First time at which a response reaches 15 % of its peak, between samples by interpolation.
double onset_samples(std::span<const float> response) {
  float peak = 0;
  for (const float value : response) peak = std::max(peak, std::abs(value));
  const float threshold = 0.15f * peak;
  for (std::size_t i = 0; i < response.size(); ++i) {
    const float now = std::abs(response[i]);
    if (!(now >= threshold) || peak == 0) continue;
    const float before = i == 0 ? 0.f : std::abs(response[i - 1]);
    return static_cast<double>(i) - (now > before ? (now - threshold) / (now - before) : 0.f);
  }
  return 0;
}

/// Spectrum of responses sampled at one rate at the bin frequencies of another: exact resampling, as the transform of a finite response is
/// known at every frequency.  Bins above the Nyquist rate of the measurement are zero.
class BinTransform {
 public:
  BinTransform(std::size_t num_taps, std::size_t num_bins, double bin_hz, double response_rate_hz)
      : used_(std::min(num_bins, static_cast<std::size_t>(std::floor(0.5 * response_rate_hz / bin_hz + 1e-9)) + 1)),
        cosine_(num_taps * used_),
        sine_(num_taps * used_),
        real_(used_),
        imaginary_(used_) {
    for (std::size_t n = 0; n < num_taps; ++n) {
      for (std::size_t k = 0; k < used_; ++k) {
        const double angle = 2.0 * std::numbers::pi * static_cast<double>(k) * bin_hz / response_rate_hz * static_cast<double>(n);
        cosine_[n * used_ + k] = static_cast<float>(std::cos(angle));
        sine_[n * used_ + k] = static_cast<float>(std::sin(angle));
      }
    }
  }
  void operator()(std::span<const float> response, std::span<Complex> spectrum) {
    std::fill(real_.begin(), real_.end(), 0.f);
    std::fill(imaginary_.begin(), imaginary_.end(), 0.f);
    for (std::size_t n = 0; n < response.size(); ++n) {
      const float value = response[n];
      const float *cosine = cosine_.data() + n * used_, *sine = sine_.data() + n * used_;
      for (std::size_t k = 0; k < used_; ++k) real_[k] += value * cosine[k];
      for (std::size_t k = 0; k < used_; ++k) imaginary_[k] -= value * sine[k];
    }
    std::fill(spectrum.begin(), spectrum.end(), Complex{});
    for (std::size_t k = 0; k < used_; ++k) spectrum[k] = {real_[k], imaginary_[k]};
  }

 private:
  std::size_t used_;                  ///< bins below the Nyquist rate of the measurement
  std::vector<float> cosine_, sine_;  ///< [tap][bin]
  std::vector<float> real_, imaginary_;
};

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

/// A rate that is wrong in the file, or rooms instead of heads: every response costs a sum over its samples for each bin.
void check_work(const SofaResponses& sofa, float sample_rate_hz, std::size_t num_bins, const std::string& where) {
  const double ratio = static_cast<double>(sample_rate_hz) / static_cast<double>(sofa.sample_rate_hz);
  const double rows = 2.0 * static_cast<double>(sofa.direction.size()), bins = static_cast<double>(num_bins);
  const double operations = rows * sofa.num_taps * bins / std::max(1.0, ratio);
  if (rows * bins * sizeof(Complex) > 4e9 || operations > 1e11)
    throw InputError(where,
                     fmt::format("holds {} responses of {} samples at {} Hz: too much for {} Hz", rows, sofa.num_taps, sofa.sample_rate_hz,
                                 sample_rate_hz),
                     "check Data.SamplingRate, or cut the responses to those of a head");
}

/// The grid of one sphere: of each direction the mean of its copies.
HeadGrid make_grid(const SofaResponses& sofa, const MeasuredSphere& sphere, double ratio, int fft_size, BinTransform& transform) {
  const auto taps = static_cast<std::size_t>(sofa.num_taps);
  HeadGrid grid;
  grid.fft_size = fft_size;
  grid.num_bins = static_cast<std::size_t>(fft_size / 2 + 1);
  if (sphere.distance_m > 0) grid.distance_m = sphere.distance_m;
  grid.aligned.resize(2 * sphere.directions.size() * grid.num_bins);
  grid.delay_samples.resize(2 * sphere.directions.size());
  std::vector<Complex> spectrum(grid.num_bins);
  for (std::size_t d = 0; d < sphere.directions.size(); ++d) {
    const std::vector<std::size_t>& copies = sphere.directions[d];
    grid.direction.push_back(sofa.direction[copies.front()]);
    const auto share = 1.f / static_cast<float>(copies.size());
    for (const std::size_t m : copies) {
      for (std::size_t ear = 0; ear < 2; ++ear) {
        const std::size_t row = 2 * m + ear, out = 2 * d + ear;
        const auto response = std::span(sofa.taps).subspan(row * taps, taps);
        transform(response, spectrum);
        const double onset = onset_samples(response);
        delay_spectrum(spectrum, -onset * ratio, fft_size);
        grid.delay_samples[out] += static_cast<double>(share) * (onset + static_cast<double>(sofa.delay_samples[row])) * ratio;
        for (std::size_t k = 0; k < grid.num_bins; ++k) grid.aligned[out * grid.num_bins + k] += share * spectrum[k];
      }
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
  if (!(power > 0)) throw InputError(where, "has no energy between 250 Hz and 4 kHz in Data.IR", "give the responses of a head");
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
        fmt::format("{}: a source on the left is {:.1f} dB louder and {:.0f} us earlier at the right ear: check whether "
                    "SourcePosition counts azimuths clockwise, or ears are exchanged",
                    where, -evidence.level_db, -1e6 * evidence.early_s));
  const double ratio = static_cast<double>(sample_rate_hz) / static_cast<double>(sofa.sample_rate_hz);
  const int length = static_cast<int>(std::ceil(static_cast<double>(sofa.num_taps) * ratio)) + 2 * lead_for(sample_rate_hz);
  const int fft_size = std::max(smallest_fft_for(sample_rate_hz), next_power_of_two(length));
  const auto num_bins = static_cast<std::size_t>(fft_size / 2 + 1);
  check_work(sofa, sample_rate_hz, num_bins, where);
  BinTransform transform(static_cast<std::size_t>(sofa.num_taps), num_bins, static_cast<double>(sample_rate_hz) / fft_size,
                         static_cast<double>(sofa.sample_rate_hz));
  const std::vector<float> unknown(sofa.distance_m.empty() ? sofa.direction.size() : 0, 0.f);
  const auto sphere = rigid_sphere(sample_rate_hz);
  std::vector<HeadGrid> grids;
  for (const MeasuredSphere& measured : sort_into_spheres(sofa.direction, sofa.distance_m.empty() ? unknown : sofa.distance_m)) {
    grids.push_back(make_grid(sofa, measured, ratio, fft_size, transform));
    bring_to_sphere(grids.back(), *sphere, where);
  }
  return std::shared_ptr<const Hrtf>(new Hrtf(sample_rate_hz, std::move(grids)));
}

}  // namespace earshot
