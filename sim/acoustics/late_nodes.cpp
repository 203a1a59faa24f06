#include "sim/acoustics/late_nodes.h"

#include <cstdint>

namespace earshot {

void LateNodes::make(const EnergyHistogram& energy, float sample_rate_hz, double onset_sample, std::size_t num_samples) {
  num_bins_ = energy.num_bins();
  num_samples_ = num_samples;
  onset_ = onset_sample;
  const int num_bands = energy.num_bands();
  width_ = static_cast<double>(energy.bin_s()) * static_cast<double>(sample_rate_hz);
  const auto cells = static_cast<std::size_t>(num_bins_) * static_cast<std::size_t>(num_bands);
  nodes_.assign(cells, LateNode{});
  hat_area_.assign(static_cast<std::size_t>(num_bins_), width_);
  const auto num_known = static_cast<std::size_t>(energy.num_coefficients() >= 4 ? energy.num_coefficients() : 1);
  num_higher_ = num_known > 4 ? num_known - 4 : 0;
  higher_.assign(cells * num_higher_, 0.f);

  // A bin's energy is spread by a hat that reaches the neighbours' centres.  Where the onset cuts the hat, what is left of it carries all.
  const auto first_sample = static_cast<std::int64_t>(std::ceil(onset_sample));
  for (int bin = 0; bin < num_bins_ && (bin - 0.5) * width_ < onset_sample; ++bin) {
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

  for (int band = 0; band < num_bands; ++band) {
    carried_.assign(num_known, 0.0);  // energy of bins that lie before the onset
    for (int bin = 0; bin < num_bins_; ++bin) {
      const auto cell = energy.at(bin, band);
      std::vector<double>& c = carried_;
      for (std::size_t k = 0; k < num_known; ++k) c[k] += static_cast<double>(cell[k]);
      const double area = hat_area_[static_cast<std::size_t>(bin)];
      if (area < 0.25 * width_ && bin + 1 < num_bins_) continue;
      const bool sounds = c[0] > 0 && c[0] < 1e30 && area > 0 && (bin - 0.5) * width_ <= static_cast<double>(num_samples);
      if (sounds) {
        const std::size_t index = static_cast<std::size_t>(band) * static_cast<std::size_t>(num_bins_) + static_cast<std::size_t>(bin);
        LateNode& node = nodes_[index];
        node.density = static_cast<float>(c[0] / area);
        double square = 0;
        for (std::size_t j = 1; j < std::min<std::size_t>(num_known, 4); ++j) square += c[j] * c[j] / (c[0] * c[0]);
        if (square >= 0) {
          const double limit = square > 3.0 ? std::sqrt(3.0 / square) : 1.0;  // rounding may point a single ray past its own energy
          for (std::size_t j = 1; j < std::min<std::size_t>(num_known, 4); ++j) node.m[j - 1] = static_cast<float>(limit * c[j] / c[0]);
          node.d = static_cast<float>(std::sqrt(std::max(0.0, 1.0 - std::min(square, 3.0) / 3.0)));
        }
        for (std::size_t j = 4; j < num_known; ++j) {
          const double ratio = c[j] / c[0];
          higher_[index * num_higher_ + j - 4] = std::isfinite(ratio) ? static_cast<float>(ratio) : 0.f;
        }
      }
      std::fill(carried_.begin(), carried_.end(), 0.0);
    }
  }
}

}  // namespace earshot
