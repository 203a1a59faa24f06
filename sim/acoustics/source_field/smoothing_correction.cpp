// SPDX-License-Identifier: Apache-2.0
#include "sim/acoustics/source_field/smoothing_correction.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <utility>

#include "sim/acoustics/core/bands.h"

namespace earshot {
namespace {

/// A window is cut into parts, whose scatter says how noisy it is: at least so many, of so many bins each.
constexpr std::size_t kParts = 4, kBinsPerPart = 2;
/// Later windows are this fraction of the elapsed time: the exchange between rooms changes as slowly as decays do.
constexpr double kWindowOfTime = 1.0 / 3;
/// Sweeps of the energy that is taken as sharp.  One leaves a sixth of the variance of the noise.
constexpr int kSharp = 1;
/// Wavelets keep 1 - kNoise variance / square of themselves.  Of noise alone 7 % of the variance is left.
constexpr double kNoise = 3;
/// No factor leaves [1 / kMost, kMost].
constexpr double kMost = 10;
constexpr double kMinRatio = 0.05;
/// Relative precision of floats, a lower limit of every error.  The other constant is a lower limit of energies, as a fraction of the
/// energy of all cells.
constexpr double kRounding = 1e-6;
constexpr float kMinEnergy = 1e-14f;

/// Wavelets of one cell and band over its windows.
struct Wavelets {
  std::span<const double> value, precision;
  std::span<double> fit;

  static double shrunk(double value, double variance) {
    const double square = value * value;
    return square > kNoise * variance ? value * (1 - kNoise * variance / square) : 0.0;
  }
  /// Mean of windows, and its precision.
  [[nodiscard]] std::pair<double, double> mean(std::size_t begin, std::size_t end) const {
    double sum = 0, weight = 0;
    for (std::size_t w = begin; w < end; ++w) sum += precision[w] * value[w], weight += precision[w];
    return {weight > 0 ? sum / weight : 0.0, weight};
  }
  void fit_all() const {
    const auto [all, weight] = mean(0, value.size());
    std::fill(fit.begin(), fit.end(), weight > 0 ? shrunk(all, 1 / weight) : 0.0);
    fit_halves(0, value.size());
  }
  void fit_halves(std::size_t begin, std::size_t end) const {
    if (end - begin < 2) return;
    const std::size_t half = (begin + end) / 2;
    const auto [early, early_weight] = mean(begin, half);
    const auto [late, late_weight] = mean(half, end);
    if (early_weight > 0 && late_weight > 0) {
      const double difference = shrunk(late - early, 1 / early_weight + 1 / late_weight) / (early_weight + late_weight);
      for (std::size_t w = begin; w < half; ++w) fit[w] -= difference * late_weight;
      for (std::size_t w = half; w < end; ++w) fit[w] += difference * early_weight;
    }
    fit_halves(begin, half);
    fit_halves(half, end);
  }
};

}  // namespace

SmoothingCorrection::SmoothingCorrection(const FieldSmoothing& smoothing, const WideningBins& bins, std::span<const int> sweeps,
                                         std::size_t num_cells, const std::vector<std::uint32_t>& active, std::size_t padded_bands,
                                         const RawEnergy& raw)
    : bins_(bins), num_cells_(num_cells), stride_(padded_bands) {
  find_windows(sweeps);
  for (const Window& window : windows_) measure(smoothing, window, active, raw);
  if (!windows_.empty()) shrink(active);
}

void SmoothingCorrection::find_windows(std::span<const int> sweeps) {
  std::size_t merged = 0;
  while (merged < sweeps.size() && sweeps[merged] <= kSharp) ++merged;
  nodes_.push_back(merged > 0 ? bins_.middle(merged - 1) : 0.0);
  while (merged < sweeps.size()) {
    const std::size_t first = bins_.first_bin(merged), part = std::max(kBinsPerPart, bins_.width(merged));
    const std::size_t end = first + std::max(kParts * part, static_cast<std::size_t>(kWindowOfTime * static_cast<double>(first)));
    Window window{.units = {merged}, .sweeps = sweeps[merged]};
    for (; merged < sweeps.size() && bins_.first_bin(merged) < end; ++merged)
      if (bins_.first_bin(merged) >= bins_.first_bin(window.units.back()) + kBinsPerPart) window.units.push_back(merged);
    window.units.push_back(merged);
    if (window.units.size() <= kParts) break;  // the rest at the end belongs to the previous window
    nodes_.push_back(0.5 * static_cast<double>(first + bins_.first_bin(merged)));
    windows_.push_back(std::move(window));
  }
  if (windows_.empty()) nodes_.clear();
}

/// Bias of a window in every cell and band, with its standard error.
void SmoothingCorrection::measure(const FieldSmoothing& smoothing, const Window& window, const std::vector<std::uint32_t>& active,
                                  const RawEnergy& raw) {
  const std::size_t parts = window.units.size() - 1, width = parts * stride_;
  std::vector<float> energy(num_cells_ * width, 0.f), spare;
  std::vector<double> total(width, 0.0), equal(width, 0.0);
  std::array<float, kMaxBands> row{};
  for (const std::uint32_t cell : active)
    for (std::size_t part = 0; part < parts; ++part)
      for (std::size_t merged = window.units[part]; merged < window.units[part + 1]; ++merged) {
        if (!raw(cell, merged, row)) continue;
        float* to = &energy[cell * width + part * stride_];
        for (std::size_t b = 0; b < stride_; ++b) to[b] += row[b];
      }
  smoothing.sweep(kSharp, width, active, energy, spare);
  for (const std::uint32_t cell : active)
    for (std::size_t i = 0; i < width; ++i) total[i] += double{energy[cell * width + i]};
  // Parts count alike: each is divided by the energy of all cells in it.
  for (std::size_t i = 0; i < width; ++i) equal[i] = total[i] > 0 ? 1 / total[i] : 0.0;

  // Scatter about a line, as the decay of a cell may differ from the mean.
  const double n = static_cast<double>(parts), middle = 0.5 * (n - 1), spread = n * (n * n - 1) / 12;
  std::vector<float> sharp(num_cells_ * stride_, 0.f), variance(num_cells_ * stride_, 0.f);
  for (const std::uint32_t cell : active)
    for (std::size_t b = 0; b < stride_; ++b) {
      double sum = 0, tilt = 0, squares = 0;
      for (std::size_t part = 0; part < parts; ++part) {
        const std::size_t i = part * stride_ + b;
        const double value = double{energy[cell * width + i]} * equal[i];
        sum += value;
        tilt += value * (static_cast<double>(part) - middle);
        squares += value * value;
      }
      sharp[cell * stride_ + b] = static_cast<float>(sum);
      variance[cell * stride_ + b] = static_cast<float>(std::max(squares - sum * sum / n - tilt * tilt / spread, 0.0) * n / (n - 2));
    }
  std::vector<float> smooth = sharp;
  spare.clear();
  smoothing.sweep(window.sweeps - kSharp, stride_, active, smooth, spare);
  smoothing.sweep(2, stride_, active, variance, spare);  // a few parts know it badly, neighbours are as noisy
  const double gain = static_cast<double>(window.sweeps + 1) / (window.sweeps - kSharp);
  std::vector<float>& missing = missing_.emplace_back(num_cells_ * stride_, 0.f);
  std::vector<float>& precision = precision_.emplace_back(num_cells_ * stride_, 0.f);
  for (const std::uint32_t cell : active)
    for (std::size_t i = cell * stride_; i < (cell + 1) * stride_; ++i) {
      if (!(smooth[i] > kMinEnergy)) continue;
      const double ratio = std::max(double{sharp[i]} / double{smooth[i]}, kMinRatio);
      const double noise = double{variance[i]} / (double{smooth[i]} * double{smooth[i]}) + kRounding * kRounding;
      missing[i] = static_cast<float>(gain * std::log(ratio));
      precision[i] = static_cast<float>(1 / (gain * gain * noise));
    }
}

void SmoothingCorrection::shrink(const std::vector<std::uint32_t>& active) {
  const std::size_t count = windows_.size();
  factors_.assign(count + 1, std::vector<float>(num_cells_ * stride_, 1.f));
  std::vector<double> value(count), precision(count), fit(count);
  for (const std::uint32_t cell : active)
    for (std::size_t i = cell * stride_; i < (cell + 1) * stride_; ++i) {
      for (std::size_t w = 0; w < count; ++w) value[w] = double{missing_[w][i]}, precision[w] = double{precision_[w][i]};
      Wavelets{value, precision, fit}.fit_all();
      for (std::size_t w = 0; w < count; ++w)
        if (fit[w] != 0) factors_[w + 1][i] = static_cast<float>(std::clamp(std::exp(fit[w]), 1 / kMost, kMost));
    }
  missing_ = {};
  precision_ = {};
}

void SmoothingCorrection::factors(std::uint32_t cell, std::size_t merged, std::span<float> to) const {
  const double at = bins_.middle(merged);
  if (nodes_.empty() || at <= nodes_.front()) {
    std::fill_n(to.begin(), stride_, 1.f);
    return;
  }
  std::size_t next = 1;
  while (next + 1 < nodes_.size() && nodes_[next] < at) ++next;
  const auto fraction = static_cast<float>(std::clamp((at - nodes_[next - 1]) / std::max(nodes_[next] - nodes_[next - 1], 1e-9), 0.0, 1.0));
  const float *before = &factors_[next - 1][cell * stride_], *after = &factors_[next][cell * stride_];
  for (std::size_t b = 0; b < stride_; ++b) to[b] = before[b] + fraction * (after[b] - before[b]);
}

}  // namespace earshot
