#include "sim/audio/head/hrtf.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <glm/geometric.hpp>
#include <limits>
#include <numbers>

#include "sim/audio/head/diffuse_decoder.h"
#include "sim/audio/head/rigid_sphere.h"
#include "sim/audio/head/sofa_reader.h"
#include "sim/audio/transforms/fft.h"
#include "sim/audio/transforms/spectrum_math.h"
#include "sim/base/errors.h"

namespace earshot {
namespace {

using Complex = std::complex<float>;

constexpr double kEarAngle = 100.0 * std::numbers::pi / 180.0;
/// Neighbours among which a measured head is interpolated.
constexpr std::size_t kNeighbours = 5;
/// Samples before time zero: the near ear is early by radius / c = 0.26 ms, and filters of limited band ring before they start.
int lead_for(float sample_rate_hz) { return static_cast<int>(std::ceil(0.002 * sample_rate_hz)); }
int taps_for(float sample_rate_hz) { return lead_for(sample_rate_hz) + static_cast<int>(std::ceil(0.006 * sample_rate_hz)); }
int smallest_fft_for(float sample_rate_hz) { return next_power_of_two(static_cast<int>(std::ceil(0.02 * sample_rate_hz))); }

/// Of the angle between a direction and that of an ear.
double cosine_at_ear(glm::dvec3 towards, int ear) {
  const double side = ear == 0 ? -std::sin(kEarAngle) : std::sin(kEarAngle);
  return towards.x * side + towards.z * -std::cos(kEarAngle);
}

void check_rate(float sample_rate_hz) {
  require(sample_rate_hz >= 4000.f && sample_rate_hz <= 384000.f, "hrtf sample_rate_hz", sample_rate_hz, "must be in [4000, 384000]");
}

}  // namespace

/// Spectra with the first arrival moved to time zero, and its delay beside them: delays and aligned spectra may be interpolated linearly,
/// spectra as measured may not (they would comb).
struct Hrtf::Grid {
  int fft_size = 0;
  std::size_t num_bins = 0;
  int intervals = 0;                  ///< sphere: rows are incidence angles, pi / intervals apart; 0 for a measured head
  std::vector<glm::vec3> direction;   ///< measured head: rows are [direction][ear]
  std::vector<Complex> aligned;       ///< [row][num_bins]
  std::vector<double> delay_samples;  ///< [row], relative to the head's centre

  struct Blend {
    std::size_t count = 0;
    std::array<std::size_t, kNeighbours> row{};
    std::array<float, kNeighbours> weight{};
  };

  [[nodiscard]] Blend blend_sphere(glm::dvec3 towards, int ear) const {
    const double position = std::acos(std::clamp(cosine_at_ear(towards, ear), -1.0, 1.0)) / std::numbers::pi * intervals;
    const auto row = static_cast<std::size_t>(std::min(position, intervals - 1.0));
    const auto weight = static_cast<float>(position - static_cast<double>(row));
    return {.count = 2, .row = {row, row + 1}, .weight = {1.f - weight, weight}};
  }

  /// Inverse-distance weights that fade to zero at the next farther neighbour (Franke and Little 1979): exact at measured directions and
  /// continuous everywhere, in gaps and at the poles, without a triangulation.  Rows of the left ear; the right one follows each.
  [[nodiscard]] Blend blend_measured(glm::dvec3 towards) const {
    std::array<std::pair<double, std::size_t>, kNeighbours + 1> nearest;
    nearest.fill({std::numeric_limits<double>::infinity(), 0});
    for (std::size_t i = 0; i < direction.size(); ++i) {
      const glm::dvec3 apart = towards - glm::dvec3(direction[i]);
      std::pair<double, std::size_t> candidate{glm::dot(apart, apart), i};
      if (candidate >= nearest.back()) continue;
      for (auto& slot : nearest)
        if (candidate < slot) std::swap(candidate, slot);
    }
    const double reach = std::sqrt(nearest[kNeighbours].first);
    Blend blend{.count = kNeighbours};
    std::array<double, kNeighbours> weight{};
    double sum = 0;
    for (std::size_t n = 0; n < kNeighbours; ++n) {
      const double distance = std::max(std::sqrt(nearest[n].first), 1e-6);
      const double root = std::max(reach - distance, 0.0) / distance;
      weight[n] = root * root;
      sum += weight[n];
    }
    for (std::size_t n = 0; n < kNeighbours; ++n) {
      blend.row[n] = 2 * nearest[n].second;
      blend.weight[n] = static_cast<float>(sum > 0 ? weight[n] / sum : 1.0 / kNeighbours);
    }
    return blend;
  }

  /// Writes an aligned spectrum and returns its delay, added to `delay`.
  double write_aligned(const Blend& blend, double delay, std::span<Complex> out) const {
    Complex* sum = out.data();
    for (std::size_t n = 0; n < blend.count; ++n) {
      const Complex* row = aligned.data() + blend.row[n] * num_bins;
      const float weight = blend.weight[n];
      delay += weight * delay_samples[blend.row[n]];
      if (n == 0)
        for (std::size_t k = 0; k < num_bins; ++k) sum[k] = weight * row[k];
      else
        for (std::size_t k = 0; k < num_bins; ++k) sum[k] += weight * row[k];
    }
    return delay;
  }

  /// Delays of the left and the right ear, added to `delay`.
  std::array<double, 2> write_aligned(glm::vec3 towards, double delay, std::span<Complex> left, std::span<Complex> right) const {
    if (intervals > 0) return {write_aligned(blend_sphere(towards, 0), delay, left), write_aligned(blend_sphere(towards, 1), delay, right)};
    Blend blend = blend_measured(towards);
    const double left_delay = write_aligned(blend, delay, left);
    for (std::size_t& row : blend.row) ++row;
    return {left_delay, write_aligned(blend, delay, right)};
  }

  void write(glm::vec3 towards, double extra_delay_samples, std::span<Complex> left, std::span<Complex> right) const {
    const std::array<double, 2> delay = write_aligned(towards, extra_delay_samples, left, right);
    delay_spectrum(left.first(num_bins), delay[0], fft_size);
    delay_spectrum(right.first(num_bins), delay[1], fft_size);
  }
};

Hrtf::Hrtf(float sample_rate_hz, std::shared_ptr<const Grid> grid, double measured_m)
    : sample_rate_hz_(sample_rate_hz),
      fft_size_(grid->fft_size),
      lead_samples_(lead_for(sample_rate_hz)),
      decoder_taps_(taps_for(sample_rate_hz)),
      grid_(std::move(grid)),
      near_(sample_rate_hz, fft_size_, measured_m) {
  const auto head = [this](glm::vec3 direction, std::span<Complex> left, std::span<Complex> right) {
    grid_->write(direction, 0.0, left, right);
  };
  decoder_ = make_diffuse_decoder(head, fft_size_, sample_rate_hz_, lead_samples_, decoder_taps_);
}

std::shared_ptr<const Hrtf> Hrtf::rigid_sphere(float sample_rate_hz) {
  check_rate(sample_rate_hz);
  auto grid = std::make_shared<Grid>();
  grid->fft_size = smallest_fft_for(sample_rate_hz);
  grid->num_bins = static_cast<std::size_t>(grid->fft_size / 2 + 1);
  // The pattern behind the head repeats every pi / ka; sixteen rows or more to a period keep linear interpolation below 0.05 dB.
  const double ka_per_hz = 2.0 * std::numbers::pi * kHeadRadiusM / kHeadSpeedOfSoundMPerS;
  const int rows_per_degree = std::max(2, static_cast<int>(std::ceil(16.0 * ka_per_hz * 0.5 * sample_rate_hz / 180.0)));
  grid->intervals = 180 * rows_per_degree;
  const auto rows = static_cast<std::size_t>(grid->intervals) + 1;
  std::vector<double> incidence(rows);
  for (std::size_t row = 0; row < rows; ++row) {
    incidence[row] = std::numbers::pi * static_cast<double>(row) / grid->intervals;
    grid->delay_samples.push_back(rigid_sphere_delay(incidence[row]) * kHeadRadiusM / kHeadSpeedOfSoundMPerS * sample_rate_hz);
  }
  grid->aligned.resize(rows * grid->num_bins);
  std::vector<std::complex<double>> pressure(rows);
  for (std::size_t k = 0; k < grid->num_bins; ++k) {
    const double frequency_hz = static_cast<double>(k) * sample_rate_hz / grid->fft_size;
    rigid_sphere_pressure(ka_per_hz * frequency_hz, incidence, pressure);
    for (std::size_t row = 0; row < rows; ++row) {
      const double advance = 2.0 * std::numbers::pi * static_cast<double>(k) * grid->delay_samples[row] / grid->fft_size;
      grid->aligned[row * grid->num_bins + k] = Complex(pressure[row] * std::polar(1.0, advance));
    }
  }
  return std::shared_ptr<const Hrtf>(new Hrtf(sample_rate_hz, std::move(grid), std::numeric_limits<double>::infinity()));
}

void Hrtf::spectra(glm::vec3 direction, std::span<std::complex<float>> left, std::span<std::complex<float>> right,
                   double extra_delay_samples, double distance_m) const {
  EARSHOT_EXPECT(left.size() >= grid_->num_bins && right.size() >= grid_->num_bins);
  const std::array<double, 2> delay = aligned_spectra(direction, left, right, distance_m);
  for (std::size_t ear = 0; ear < 2; ++ear)
    delay_spectrum((ear == 0 ? left : right).first(grid_->num_bins), lead_samples_ + extra_delay_samples + delay[ear], fft_size_);
}

std::array<double, 2> Hrtf::aligned_spectra(glm::vec3 direction, std::span<std::complex<float>> left, std::span<std::complex<float>> right,
                                            double distance_m) const {
  EARSHOT_EXPECT(left.size() >= grid_->num_bins && right.size() >= grid_->num_bins);
  std::array<double, 2> delay = grid_->write_aligned(direction, 0.0, left, right);
  if (NearHead::applies(distance_m))
    for (const int ear : {0, 1})
      delay[static_cast<std::size_t>(ear)] +=
          near_.apply(distance_m, std::acos(std::clamp(cosine_at_ear(direction, ear), -1.0, 1.0)), ear == 0 ? left : right);
  return delay;
}

std::span<const std::complex<float>> Hrtf::diffuse_decoder(int channel, int ear) const {
  EARSHOT_EXPECT(channel >= 0 && channel < 4 && ear >= 0 && ear < 2);
  return decoder_[static_cast<std::size_t>(2 * channel + ear)];
}

namespace {

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
double mean_power(const std::vector<Complex>& left, const std::vector<Complex>& right, double bin_hz) {
  double sum = 0, count = 0;
  for (std::size_t k = 0; k < left.size(); ++k) {
    const double frequency_hz = static_cast<double>(k) * bin_hz;
    if (frequency_hz < 250 || frequency_hz > 4000) continue;
    sum += 0.5 * (std::norm(left[k]) + std::norm(right[k]));
    count += 1;
  }
  return sum / std::max(count, 1.0);
}

}  // namespace

std::shared_ptr<const Hrtf> Hrtf::from_sofa(const std::filesystem::path& path, float sample_rate_hz) {
  check_rate(sample_rate_hz);
  return from_responses(read_sofa(path), sample_rate_hz, path.string());
}

std::shared_ptr<const Hrtf> Hrtf::from_responses(const SofaResponses& sofa, float sample_rate_hz, const std::string& where) {
  check_rate(sample_rate_hz);
  validate(sofa, where);
  const double ratio = static_cast<double>(sample_rate_hz) / sofa.sample_rate_hz;
  const auto taps = static_cast<std::size_t>(sofa.num_taps);
  auto grid = std::make_shared<Grid>();
  grid->direction = sofa.direction;
  const int length = static_cast<int>(std::ceil(static_cast<double>(taps) * ratio)) + 2 * lead_for(sample_rate_hz);
  grid->fft_size = std::max(smallest_fft_for(sample_rate_hz), next_power_of_two(length));
  grid->num_bins = static_cast<std::size_t>(grid->fft_size / 2 + 1);
  const std::size_t rows = 2 * sofa.direction.size();
  // A rate that is wrong in the file, or rooms instead of heads: every response costs a sum over its samples for each bin.
  const double spectra_bytes = static_cast<double>(rows * grid->num_bins) * sizeof(Complex);
  const double operations =
      static_cast<double>(rows) * static_cast<double>(taps) * static_cast<double>(grid->num_bins) / std::max(1.0, ratio);
  if (spectra_bytes > 4e9 || operations > 1e11)
    throw InputError(
        where,
        fmt::format("holds {} responses of {} samples at {} Hz: too much for {} Hz", rows, taps, sofa.sample_rate_hz, sample_rate_hz),
        "check Data.SamplingRate, or cut the responses to those of a head");
  grid->aligned.resize(rows * grid->num_bins);
  const double bin_hz = static_cast<double>(sample_rate_hz) / grid->fft_size;
  BinTransform transform(taps, grid->num_bins, bin_hz, sofa.sample_rate_hz);
  for (std::size_t row = 0; row < rows; ++row) {
    const auto response = std::span(sofa.taps).subspan(row * taps, taps);
    const auto spectrum = std::span(grid->aligned).subspan(row * grid->num_bins, grid->num_bins);
    transform(response, spectrum);
    const double onset = onset_samples(response);
    delay_spectrum(spectrum, -onset * ratio, grid->fft_size);
    grid->delay_samples.push_back((onset + sofa.delay_samples[row]) * ratio);
  }

  // Time zero is the head's centre, level that of the rigid sphere: both from means over evenly spread directions.
  const auto sphere = rigid_sphere(sample_rate_hz);
  double delay = 0, power = 0, sphere_power = 0;
  constexpr int num_directions = 500;
  std::vector<Complex> left(grid->num_bins), right(grid->num_bins), sphere_left(static_cast<std::size_t>(sphere->fft_size() / 2 + 1)),
      sphere_right(sphere_left.size());
  for (int i = 0; i < num_directions; ++i) {
    const double height = (2.0 * i + 1.0) / num_directions - 1.0, radius = std::sqrt(1.0 - height * height);
    const double angle = 2.0 * std::numbers::pi * std::fmod(i * std::numbers::phi, 1.0);
    const glm::vec3 towards(radius * std::cos(angle), height, radius * std::sin(angle));
    const auto blend = grid->blend_measured(towards);
    for (std::size_t n = 0; n < blend.count; ++n)
      delay += 0.5 * blend.weight[n] * (grid->delay_samples[blend.row[n]] + grid->delay_samples[blend.row[n] + 1]);
    grid->write(towards, 0.0, left, right);
    sphere->spectra(towards, sphere_left, sphere_right);
    power += mean_power(left, right, bin_hz);
    sphere_power += mean_power(sphere_left, sphere_right, static_cast<double>(sample_rate_hz) / sphere->fft_size());
  }
  if (!(power > 0)) throw InputError(where, "has no energy between 250 Hz and 4 kHz in Data.IR", "give the responses of a head");
  // The mean over directions of the sphere's delay, (pi - 3) / 4 radius / c, is what "centre" means for it.
  const double sphere_delay = 0.25 * (std::numbers::pi - 3.0) * kHeadRadiusM / kHeadSpeedOfSoundMPerS * sample_rate_hz;
  for (double& value : grid->delay_samples) value += sphere_delay - delay / num_directions;
  const auto gain = static_cast<float>(std::sqrt(sphere_power / power));
  for (Complex& value : grid->aligned) value *= gain;
  const double measured_m = sofa.distance_m > 0 ? static_cast<double>(sofa.distance_m) : std::numeric_limits<double>::infinity();
  return std::shared_ptr<const Hrtf>(new Hrtf(sample_rate_hz, std::move(grid), measured_m));
}

}  // namespace earshot
