// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <algorithm>
#include <array>
#include <cmath>
#include <cstddef>
#include <span>
#include <vector>

#include "sim/acoustics/core/energy_histogram.h"
#include "sim/acoustics/core/widening_bins.h"

namespace earshot {

/// Late energy of one band in the middle of one merged bin (widening_bins.h).
struct LateEnvelopeSample {
  float density = 0;         ///< energy per sample
  std::array<float, 3> m{};  ///< N3D channels 1 to 3 over channel 0: sqrt 3 times the mean direction, by energy
  float d = 1;               ///< amplitude of what is independent of channel 0 in each of them: d^2 = 1 - |m|^2 / 3
};

/// A segment of samples between the middles of two merged bins on which densities change linearly.
struct LateSegment {
  std::size_t begin;  ///< first sample
  int count;          ///< of samples
  int left, right;    ///< merged bins at its ends
  double fraction;    ///< of the way from left to right at `begin`
  double step;        ///< of that fraction per sample
};

/// Linear change over a segment.
struct Ramp {
  float start, step;
  [[nodiscard]] float at(int i) const { return start + step * static_cast<float>(i); }
};
inline Ramp ramp_over(const LateSegment& segment, float left, float right) {
  const double change = static_cast<double>(right) - static_cast<double>(left);
  return {static_cast<float>(static_cast<double>(left) + segment.fraction * change), static_cast<float>(change * segment.step)};
}

/// The late part of a histogram as densities in the middle of merged bins.  Interpolated linearly they keep each merged bin's energy, but
/// for what lies before the onset, which lands behind it, the last 1e-7 of each band, and three merged bins where the width changes: those
/// two and a last one that is cut short keep the sum of an even density.  Owns its storage: no allocation once warm.
class LateEnvelope {
 public:
  /// onset_sample: no sound before it.  num_samples: of the response.
  void make(const EnergyHistogram& energy, float sample_rate_hz, double onset_sample, std::size_t num_samples);
  [[nodiscard]] std::span<const LateEnvelopeSample> band(int band) const {
    return std::span(samples_).subspan(static_cast<std::size_t>(band) * bins_.size(), bins_.size());
  }
  /// Harmonics 4, 5, ... over channel 0 of a node: [num_coefficients - 4], empty for first order.
  [[nodiscard]] std::span<const float> higher(int band, int merged) const {
    return std::span(higher_).subspan((static_cast<std::size_t>(band) * bins_.size() + static_cast<std::size_t>(merged)) * num_higher_,
                                      num_higher_);
  }

  /// Calls visit(segment) for all segments, in order of time and cut to at most max_count samples.  Before the first and after the last
  /// middle the density stays.
  template <class Visit>
  void visit(std::size_t max_count, Visit&& visit) const {
    const std::size_t last = bins_.size();
    for (std::size_t segment = 0; segment <= last; ++segment) {
      const double from = segment == 0 ? 0.0 : bins_.middle(segment - 1) * width_;
      const double to = (segment == last ? static_cast<double>(num_bins_) : bins_.middle(segment)) * width_;
      const double per_sample = 1.0 / (to - from);
      const std::size_t end = clamp_sample(to);
      for (std::size_t begin = std::max(clamp_sample(from), clamp_sample(onset_)); begin < end;) {
        const auto count = static_cast<int>(std::min(end - begin, max_count));
        const double fraction = (static_cast<double>(begin) - from) * per_sample;
        visit(LateSegment{begin, count, static_cast<int>(segment > 0 ? segment - 1 : 0), static_cast<int>(std::min(segment, last - 1)),
                          fraction, per_sample});
        begin += static_cast<std::size_t>(count);
      }
    }
  }
  [[nodiscard]] int size() const { return static_cast<int>(bins_.size()); }  ///< merged bins
  [[nodiscard]] int num_bands() const { return num_bands_; }
  /// Where late sound begins, in samples: the onset, or the first merged bin with sound if that comes later.
  [[nodiscard]] double first_sound() const;
  /// First merged bin whose middle does not lie before `sample`; size() if there is none.
  [[nodiscard]] int bin_from(double sample) const;
  /// Of all bands, before each merged bin and behind the last: [size() + 1], of the whole, from 0 to 1; 0 without any.
  void energy_before(std::vector<float>& before) const;
  [[nodiscard]] double middle_sample(int merged) const { return bins_.middle(static_cast<std::size_t>(merged)) * width_; }
  /// First sample behind all segments that end in a merged bin before `merged` or in its middle.
  [[nodiscard]] std::size_t end_before(int merged) const {
    return merged < size() ? clamp_sample(bins_.middle(static_cast<std::size_t>(merged)) * width_) : num_samples_;
  }

 private:
  void drop_inaudible_end(int band);
  [[nodiscard]] std::size_t clamp_sample(double position) const {
    return static_cast<std::size_t>(std::clamp(std::ceil(position), 0.0, static_cast<double>(num_samples_)));
  }

  void resize(const EnergyHistogram& energy);
  void cut_hats();
  void set_bins_at_onset(const EnergyHistogram& energy, int end_bin);
  void set_whole_bins(const EnergyHistogram& energy, std::size_t first_merged);
  [[nodiscard]] int last_bin() const;

  /// c: harmonics of its energy, from 0 on.  area: samples over which it spreads.
  void set_sample(int band, int bin, std::span<const double> c, double area);
  template <class Float>
  void set_higher(std::size_t index, const Float* c, std::size_t num_known);

  int num_bins_ = 0, num_bands_ = 0;
  WideningBins bins_;
  double width_ = 1, onset_ = 0;  ///< in samples
  std::size_t num_samples_ = 0, num_higher_ = 0;
  std::vector<LateEnvelopeSample> samples_;  ///< [band][merged bin]
  std::vector<float> higher_;                ///< [band][merged bin][num_higher]
  std::vector<double> hat_area_;             ///< [bin]: samples over which a bin spreads
  std::vector<double> carried_;
  std::vector<float> sum_;  ///< of one merged bin: [band][coefficient]
};

}  // namespace earshot
