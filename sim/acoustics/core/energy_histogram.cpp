// SPDX-License-Identifier: Apache-2.0
#include "sim/acoustics/core/energy_histogram.h"

#include <algorithm>
#include <cmath>

#include "sim/base/errors.h"

namespace earshot {
namespace {

/// cell[band][k] += energy[band] * sh[k]; Count is the number of coefficients when it is known.
template <int Count>
void add_products(float* cell, std::span<const float> energy, const float* sh, int count, float weight) {
  const int num_coefficients = Count > 0 ? Count : count;
  for (const float value : energy) {
    const float weighted = value * weight;
    for (int k = 0; k < num_coefficients; ++k) cell[k] += weighted * sh[k];
    cell += num_coefficients;
  }
}

}  // namespace

EnergyHistogram::EnergyHistogram(int num_bins, int num_bands, int sh_order, float bin_s)
    : num_bins_(num_bins), num_bands_(num_bands), num_coefficients_((sh_order + 1) * (sh_order + 1)), bin_s_(bin_s) {
  EARSHOT_EXPECT(num_bins >= 0 && num_bands >= 0 && sh_order >= 0 && bin_s > 0);
  values_.assign(static_cast<std::size_t>(num_bins) * num_bands * num_coefficients_, 0.f);
}

std::span<const float> EnergyHistogram::at(int bin, int band) const {
  const std::size_t cell = static_cast<std::size_t>(bin) * num_bands_ + band;
  return std::span(values_).subspan(cell * num_coefficients_, num_coefficients_);
}

std::vector<double> EnergyHistogram::band_energy(int band) const {
  std::vector<double> energies(num_bins_);
  for (int bin = 0; bin < num_bins_; ++bin) energies[bin] = energy(bin, band);
  return energies;
}

void EnergyHistogram::add(float time_s, std::span<const float> energy, std::span<const float> sh) {
  EARSHOT_EXPECT(static_cast<int>(energy.size()) == num_bands_ && static_cast<int>(sh.size()) == num_coefficients_);
  const float position = time_s / bin_s_;
  // Compared as floats before any cast: a path of any length, even infinite, cannot overflow the index.
  if (!(position >= 0.f && position <= static_cast<float>(num_bins_))) {
    for (const float value : energy) dropped_energy_ += value;
    return;
  }
  const float from_centre = position - 0.5f;  // in bins, counted from the centre of bin 0
  int bin = static_cast<int>(std::floor(from_centre));
  float upper_weight = from_centre - static_cast<float>(bin);
  // Before the first centre and after the last there is only one bin to go to.
  if (bin < 0) {
    bin = 0;
    upper_weight = 0.f;
  } else if (bin + 1 >= num_bins_) {
    bin = num_bins_ - 1;
    upper_weight = 0.f;
  }
  const std::size_t stride = static_cast<std::size_t>(num_bands_) * num_coefficients_;
  float* lower = values_.data() + bin * stride;
  const auto deposit = [&](float* cell, float weight) {
    switch (num_coefficients_) {
      case 1:
        return add_products<1>(cell, energy, sh.data(), 1, weight);
      case 4:
        return add_products<4>(cell, energy, sh.data(), 4, weight);
      default:
        return add_products<0>(cell, energy, sh.data(), num_coefficients_, weight);
    }
  };
  deposit(lower, 1.f - upper_weight);
  if (upper_weight > 0.f) deposit(lower + stride, upper_weight);
}

void EnergyHistogram::add(const EnergyHistogram& other) {
  EARSHOT_EXPECT(values_.size() == other.values_.size() && num_bins_ == other.num_bins_ && num_bands_ == other.num_bands_);
  for (std::size_t i = 0; i < values_.size(); ++i) values_[i] += other.values_[i];
  dropped_energy_ += other.dropped_energy_;
}

void EnergyHistogram::scale(float factor) {
  for (float& value : values_) value *= factor;
  dropped_energy_ *= factor;
}

void EnergyHistogram::scale(std::span<const float> factor) {
  float* value = values_.data();
  for (int bin = 0; bin < num_bins_; ++bin)
    for (int band = 0; band < num_bands_; ++band)
      for (int k = 0; k < num_coefficients_; ++k) *value++ *= factor[static_cast<std::size_t>(band)];
}

void EnergyHistogram::attenuate(std::span<const float> energy_per_m, float speed_of_sound_m_per_s) {
  EARSHOT_EXPECT(static_cast<int>(energy_per_m.size()) == num_bands_);
  if (std::all_of(energy_per_m.begin(), energy_per_m.end(), [](float m) { return m == 0.f; })) return;
  for (int band = 0; band < num_bands_; ++band) {
    // exp of the centre time for bin 0, then one factor per bin, in double: no exponential per bin.
    const double per_bin = std::exp(-double{energy_per_m[band]} * speed_of_sound_m_per_s * bin_s_);
    double factor = std::sqrt(per_bin);
    for (int bin = 0; bin < num_bins_; ++bin, factor *= per_bin) {
      float* cell = values_.data() + (static_cast<std::size_t>(bin) * num_bands_ + band) * num_coefficients_;
      for (int k = 0; k < num_coefficients_; ++k) cell[k] *= static_cast<float>(factor);
    }
  }
}

void EnergyHistogram::clear() {
  std::fill(values_.begin(), values_.end(), 0.f);
  dropped_energy_ = 0;
}

}  // namespace earshot
