// SPDX-License-Identifier: Apache-2.0
#include "sim/audio/measured/source_bands.h"

#include <algorithm>
#include <cmath>
#include <cstddef>

namespace earshot {
namespace {

constexpr double kMostOutOfPhase = 0.1, kLeastAgreement = 0.75;

struct LineWeight {
  std::size_t line;
  double weight;
};
struct Band {
  double centre_hz;
  std::vector<LineWeight> lines;
};

/// Weights of the lines from `first` to before `last`: half the frequency between the neighbours of each.
std::vector<LineWeight> weights_of(const std::vector<double>& frequency, std::size_t first, std::size_t last) {
  std::vector<LineWeight> weights;
  double sum = 0;
  for (std::size_t i = first; i < last; ++i) {
    const double below = frequency[i == 0 ? 0 : i - 1], above = frequency[std::min(i + 1, frequency.size() - 1)];
    weights.push_back({i, above - below});
    sum += above - below;
  }
  for (LineWeight& entry : weights) entry.weight = sum > 0 ? entry.weight / sum : 1.0 / static_cast<double>(weights.size());
  return weights;
}

std::vector<Band> third_octaves_of(const std::vector<double>& frequency) {
  const double lowest = std::log2(frequency.front() / 1000.0) * 3, highest = std::log2(frequency.back() / 1000.0) * 3;
  const double half = std::exp2(1.0 / 6.0);
  std::vector<Band> bands;
  for (auto k = static_cast<int>(std::ceil(lowest - 1e-6)); k <= static_cast<int>(std::floor(highest + 1e-6)); ++k) {
    const double centre = 1000.0 * std::exp2(k / 3.0);
    const auto at = [&](double hz) { return static_cast<std::size_t>(std::ranges::lower_bound(frequency, hz) - frequency.begin()); };
    const std::size_t first = at(centre / half), last = at(centre * half);
    Band band{centre, {}};
    if (last >= first + 2) {
      band.lines = weights_of(frequency, first, last);
    } else {
      const std::size_t high = std::clamp<std::size_t>(at(centre), 1, frequency.size() - 1);
      const double up = std::clamp(std::log(centre / frequency[high - 1]) / std::log(frequency[high] / frequency[high - 1]), 0.0, 1.0);
      band.lines = {{high - 1, 1 - up}, {high, up}};
    }
    bands.push_back(std::move(band));
  }
  if (bands.empty()) bands.push_back({std::sqrt(frequency.front() * frequency.back()), weights_of(frequency, 0, frequency.size())});
  return bands;
}

std::vector<Band> bands_for(const std::vector<double>& frequency) {
  constexpr double apart = 1.189;  // a quarter of an octave
  bool is_sparse = true;
  for (std::size_t i = 1; i < frequency.size(); ++i) is_sparse &= frequency[i] >= apart * frequency[i - 1];
  if (!is_sparse) return third_octaves_of(frequency);
  std::vector<Band> bands;
  for (std::size_t i = 0; i < frequency.size(); ++i) bands.push_back({frequency[i], {{i, 1.0}}});
  return bands;
}

}  // namespace

SourceBands bands_of(const MeasuredSource& source, std::span<const std::complex<double>> front) {
  const std::size_t directions = source.direction.size(), lines = source.frequency_hz.size();
  SourceBands result;
  for (const Band& band : bands_for(source.frequency_hz)) {
    std::vector<double> power(directions);
    std::vector<std::complex<double>> product(directions);
    double front_power = 0, total = 0, coherent = 0, out_of_phase = 0;
    for (const LineWeight& entry : band.lines) front_power += entry.weight * std::norm(front[entry.line]);
    for (std::size_t d = 0; d < directions; ++d) {
      for (const LineWeight& entry : band.lines) {
        const std::complex<double> value(source.pressure[d * lines + entry.line]);
        power[d] += entry.weight * std::norm(value);
        product[d] += entry.weight * value * std::conj(front[entry.line]);
      }
      total += power[d] * front_power;
      coherent += std::norm(product[d]);
      out_of_phase += product[d].imag() * product[d].imag();
    }
    const bool has_polarity = coherent >= kLeastAgreement * total && out_of_phase <= kMostOutOfPhase * coherent;
    result.centre_hz.push_back(band.centre_hz);
    result.has_polarity.push_back(has_polarity);
    for (std::size_t d = 0; d < directions; ++d)
      result.pressure.push_back(has_polarity && product[d].real() < 0 ? -std::sqrt(power[d]) : std::sqrt(power[d]));
  }
  return result;
}

}  // namespace earshot
