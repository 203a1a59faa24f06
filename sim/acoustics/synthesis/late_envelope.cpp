// SPDX-License-Identifier: Apache-2.0
#include "sim/acoustics/synthesis/late_envelope.h"

#include <algorithm>
#include <cstdint>

namespace earshot {
namespace {

/// A band's sound ends where only this fraction of its energy is left, 70 dB down: of a decay that T30 needs to -35 dB and observations
/// hear to -45 dB.  Bands that fall faster than the slowest one then cost less.
constexpr double kInaudibleFraction = 1e-7;

/// A merged bin that spreads over its own width, in float: the most frequent kind.  c: its harmonics.
inline void set_whole(LateEnvelopeSample& sample, const float* c, bool has_moments, float per_width) {
  if (!(c[0] > 0.f && c[0] < 1e30f)) return;
  sample.density = c[0] * per_width;
  if (!has_moments) return;
  const float per_energy = 1.f / c[0], m1 = per_energy * c[1], m2 = per_energy * c[2], m3 = per_energy * c[3];
  const float square = m1 * m1 + m2 * m2 + m3 * m3;
  // The reciprocal of an energy below 3e-39 is infinite.
  if (!(square >= 0.f && square < 1e30f)) return;
  const float limit = square > 3.f ? std::sqrt(3.f / square) : 1.f;  // as in set_sample
  sample.m = {limit * m1, limit * m2, limit * m3};
  sample.d = std::sqrt(std::max(0.f, 1.f - square * (1.f / 3.f)));
}

}  // namespace

template <class Float>
void LateEnvelope::set_higher(std::size_t index, const Float* c, std::size_t num_known) {
  for (std::size_t j = 4; j < num_known; ++j) {
    const double ratio = static_cast<double>(c[j]) / static_cast<double>(c[0]);
    higher_[index * num_higher_ + j - 4] = std::isfinite(ratio) ? static_cast<float>(ratio) : 0.f;
  }
}

void LateEnvelope::make(const EnergyHistogram& energy, float sample_rate_hz, double onset_sample, std::size_t num_samples) {
  num_samples_ = num_samples;
  onset_ = onset_sample;
  width_ = static_cast<double>(energy.bin_s()) * static_cast<double>(sample_rate_hz);
  resize(energy);
  cut_hats();
  // From here on no hat is cut and nothing is carried.
  const int first_whole_bin = onset_ > 0 ? static_cast<int>(std::min(onset_ / width_ + 2.5, 1e9)) : 1;
  const int first_merged = std::min(first_whole_bin, static_cast<int>(bins_.fine()));
  set_bins_at_onset(energy, first_merged);
  set_whole_bins(energy, static_cast<std::size_t>(first_merged));
  for (int band = 0; band < num_bands_; ++band) drop_inaudible_end(band);
}

void LateEnvelope::resize(const EnergyHistogram& energy) {
  num_bins_ = energy.num_bins();
  num_bands_ = energy.num_bands();
  // From the onset: where widths change, a steep decay gains a little, and should not while it is loud.
  bins_ = WideningBins(num_bins_, static_cast<std::size_t>(std::clamp(onset_ / width_, 0.0, 1e9)));
  const std::size_t cells = bins_.size() * static_cast<std::size_t>(num_bands_);
  samples_.assign(cells, LateEnvelopeSample{});
  hat_area_.assign(static_cast<std::size_t>(num_bins_), width_);
  const auto num_known = static_cast<std::size_t>(energy.num_coefficients() >= 4 ? energy.num_coefficients() : 1);
  num_higher_ = num_known > 4 ? num_known - 4 : 0;
  higher_.assign(cells * num_higher_, 0.f);
  carried_.resize(num_known);
  sum_.resize(static_cast<std::size_t>(num_bands_) * static_cast<std::size_t>(energy.num_coefficients()));
}

/// A single bin's energy is spread by a hat that reaches the neighbours' centres.  If the onset cuts the hat, the rest of the hat carries
/// all energy.
void LateEnvelope::cut_hats() {
  const auto first_sample = static_cast<std::int64_t>(std::ceil(onset_));
  for (int bin = 0; bin < num_bins_ && (bin - 0.5) * width_ < onset_; ++bin) {
    const double centre = (bin + 0.5) * width_;
    double area = 0;
    for (auto n = std::max<std::int64_t>(first_sample, static_cast<std::int64_t>(std::ceil(centre - width_)));
         n < static_cast<std::int64_t>(centre + width_) + 1; ++n) {
      const double distance = (static_cast<double>(n) - centre) / width_;
      const bool flat = (bin == 0 && distance < 0) || (bin + 1 == num_bins_ && distance > 0);
      area += flat ? (std::abs(distance) <= 0.5 ? 1.0 : 0.0) : std::max(0.0, 1.0 - std::abs(distance));
    }
    hat_area_[static_cast<std::size_t>(bin)] = area;
  }
}

/// The last bin that may reach into the response.
int LateEnvelope::last_bin() const { return std::min(num_bins_ - 1, static_cast<int>(static_cast<double>(num_samples_) / width_ + 0.5)); }

/// Bins before end_bin: energy before the onset moves to the first bin with a hat after it.
void LateEnvelope::set_bins_at_onset(const EnergyHistogram& energy, int end_bin) {
  const std::size_t coefficients = static_cast<std::size_t>(energy.num_coefficients()), stride = sum_.size();
  const int last = last_bin();
  double* c = carried_.data();  // energy of the bin, and of those before the onset
  for (int band = 0; band < num_bands_; ++band) {
    std::ranges::fill(carried_, 0.0);
    const float* cell = energy.values().data() + static_cast<std::size_t>(band) * coefficients;
    for (int bin = 0; bin <= last && bin < end_bin; ++bin, cell += stride) {
      const double area = hat_area_[static_cast<std::size_t>(bin)];
      for (std::size_t k = 0; k < carried_.size(); ++k) c[k] += static_cast<double>(cell[k]);
      if (area < 0.25 * width_ && bin + 1 < num_bins_) continue;
      if (c[0] > 0 && c[0] < 1e30 && area > 0) set_sample(band, bin, std::span(carried_), area);
      std::ranges::fill(carried_, 0.0);
    }
  }
}

/// Merged bins from first_merged on, each spread over its own width.
void LateEnvelope::set_whole_bins(const EnergyHistogram& energy, std::size_t first_merged) {
  const auto coefficients = static_cast<std::size_t>(energy.num_coefficients());
  const std::size_t stride = sum_.size(), num_known = carried_.size();
  const int last = last_bin();
  // A segment to the middle of a merged bin may begin within the response though the merged bin does not.
  const auto begins_before_the_end = [&](std::size_t merged) {
    return bins_.middle(merged - 1) * width_ < static_cast<double>(num_samples_);
  };
  for (std::size_t merged = first_merged; merged < bins_.size(); ++merged) {
    const bool is_wide = merged >= bins_.fine();
    if (is_wide ? !begins_before_the_end(merged) : static_cast<int>(merged) > last) continue;
    const float* all_bands = energy.values().data() + bins_.first_bin(merged) * stride;
    if (is_wide) {
      std::fill_n(sum_.begin(), stride, 0.f);
      for (std::size_t i = 0; i < bins_.width(merged); ++i, all_bands += stride)
        for (std::size_t k = 0; k < stride; ++k) sum_[k] += all_bands[k];
      all_bands = sum_.data();
    }
    const auto per_width = static_cast<float>(1.0 / (static_cast<double>(bins_.width(merged)) * width_));
    for (int band = 0; band < num_bands_; ++band) {
      const float* c = all_bands + static_cast<std::size_t>(band) * coefficients;
      const std::size_t index = static_cast<std::size_t>(band) * bins_.size() + merged;
      set_whole(samples_[index], c, num_known >= 4, per_width);
      if (samples_[index].density > 0.f) set_higher(index, c, num_known);
    }
  }
}

double LateEnvelope::first_sound() const {
  for (std::size_t merged = 0; merged < bins_.size(); ++merged)
    for (int band = 0; band < num_bands_; ++band)
      if (samples_[static_cast<std::size_t>(band) * bins_.size() + merged].density > 0.f)
        return std::max(onset_, static_cast<double>(bins_.first_bin(merged)) * width_);
  return onset_;
}

void LateEnvelope::energy_before(std::vector<float>& before) const {
  before.resize(bins_.size() + 1);
  double sum = 0;
  for (std::size_t merged = 0; merged < bins_.size(); ++merged) {
    before[merged] = static_cast<float>(sum);
    double density = 0;
    for (std::size_t band = 0; band < static_cast<std::size_t>(num_bands_); ++band)
      density += static_cast<double>(samples_[band * bins_.size() + merged].density);
    sum += density * static_cast<double>(bins_.width(merged));
  }
  before.back() = static_cast<float>(sum);
  const double per_energy = sum > 0 ? 1 / sum : 0.0;
  for (float& value : before) value = static_cast<float>(per_energy * static_cast<double>(value));
}

int LateEnvelope::bin_from(double sample) const {
  int first = 0, last = size();
  while (first < last) {
    const int merged = (first + last) / 2;
    if (bins_.middle(static_cast<std::size_t>(merged)) * width_ < sample)
      first = merged + 1;
    else
      last = merged;
  }
  return first;
}

void LateEnvelope::drop_inaudible_end(int band) {
  const auto row = std::span(samples_).subspan(static_cast<std::size_t>(band) * bins_.size(), bins_.size());
  double total = 0, tail = 0;
  const auto energy_in = [&](std::size_t merged) {
    return static_cast<double>(row[merged].density) * static_cast<double>(bins_.width(merged));
  };
  for (std::size_t merged = 0; merged < row.size(); ++merged) total += energy_in(merged);
  for (std::size_t merged = row.size(); merged-- > 0;) {
    tail += energy_in(merged);
    if (tail > kInaudibleFraction * total) return;
    row[merged].density = 0.f;
  }
}

void LateEnvelope::set_sample(int band, int bin, std::span<const double> c, double area) {
  const std::size_t index = static_cast<std::size_t>(band) * bins_.size() + static_cast<std::size_t>(bin);
  LateEnvelopeSample& sample = samples_[index];
  sample.density = static_cast<float>(c[0] / area);
  if (c.size() < 4) return;
  const double per_energy = 1.0 / c[0], m1 = per_energy * c[1], m2 = per_energy * c[2], m3 = per_energy * c[3];
  const double square = m1 * m1 + m2 * m2 + m3 * m3;
  if (square >= 0) {
    const double limit = square > 3.0 ? std::sqrt(3.0 / square) : 1.0;  // rounding may point a single ray past its own energy
    sample.m = {static_cast<float>(limit * m1), static_cast<float>(limit * m2), static_cast<float>(limit * m3)};
    sample.d = std::sqrt(static_cast<float>(std::max(0.0, 1.0 - std::min(square, 3.0) * (1.0 / 3.0))));
  }
  set_higher(index, c.data(), c.size());
}

}  // namespace earshot
