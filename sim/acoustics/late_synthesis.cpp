#include "sim/acoustics/late_synthesis.h"

#include <algorithm>
#include <cmath>

#include "sim/base/errors.h"

namespace earshot {
namespace {

/// Value at one end of a stretch and its change per sample.
struct Ramp {
  float start, step;
  [[nodiscard]] float at(int i) const { return start + step * static_cast<float>(i); }
};

void add_omni(int count, Ramp density, const float* w, float* out) {
  for (int i = 0; i < count; ++i) out[i] += std::sqrt(std::max(density.at(i), 0.f)) * w[i];
}

/// Amplitudes of the four channels at one stretch.
struct FirstOrderRamps {
  Ramp density, m1, m2, m3, d;
};

// Without the promise that the outputs overlap nothing, the loop is not vectorized (3 times the time).
void add_first_order(int count, FirstOrderRamps ramps, const float* w, const float* n1, const float* n2, const float* n3,
                     float* __restrict out0, float* __restrict out1, float* __restrict out2, float* __restrict out3) {
  for (int i = 0; i < count; ++i) {
    const float s = std::sqrt(std::max(ramps.density.at(i), 0.f));
    const float omni = s * w[i], diffuse = s * ramps.d.at(i);
    out0[i] += omni;
    out1[i] += ramps.m1.at(i) * omni + diffuse * n1[i];
    out2[i] += ramps.m2.at(i) * omni + diffuse * n2[i];
    out3[i] += ramps.m3.at(i) * omni + diffuse * n3[i];
  }
}

}  // namespace

void LateSynthesizer::make_nodes(const EnergyHistogram& energy, double onset_sample, std::size_t num_samples) {
  const int num_bins = energy.num_bins(), num_bands = energy.num_bands();
  const double width = static_cast<double>(energy.bin_s()) * rate_hz_;
  nodes_.assign(static_cast<std::size_t>(num_bins) * static_cast<std::size_t>(num_bands), Node{});
  hat_area_.assign(static_cast<std::size_t>(num_bins), width);

  // A bin's energy is spread by a hat that reaches the neighbours' centres.  Where the onset cuts the hat, what is left of it carries all.
  const auto first_sample = static_cast<std::int64_t>(std::ceil(onset_sample));
  for (int bin = 0; bin < num_bins && (bin - 0.5) * width < onset_sample; ++bin) {
    const double centre = (bin + 0.5) * width;
    double area = 0;
    for (auto n = std::max<std::int64_t>(first_sample, static_cast<std::int64_t>(std::ceil(centre - width)));
         n < static_cast<std::int64_t>(centre + width) + 1; ++n) {
      const double distance = (static_cast<double>(n) - centre) / width;
      const bool flat = (bin == 0 && distance < 0) || (bin + 1 == num_bins && distance > 0);
      area += flat ? (std::abs(distance) <= 0.5 ? 1.0 : 0.0) : std::max(0.0, 1.0 - std::abs(distance));
    }
    hat_area_[static_cast<std::size_t>(bin)] = area;
  }

  const int num_known = energy.num_coefficients() >= 4 ? 4 : 1;
  for (int band = 0; band < num_bands; ++band) {
    std::array<double, 4> carried{};  // energy of bins that lie before the onset
    for (int bin = 0; bin < num_bins; ++bin) {
      std::array<double, 4> c = carried;
      const auto cell = energy.at(bin, band);
      for (int k = 0; k < num_known; ++k) c[static_cast<std::size_t>(k)] += static_cast<double>(cell[static_cast<std::size_t>(k)]);
      const double area = hat_area_[static_cast<std::size_t>(bin)];
      if (area < 0.25 * width && bin + 1 < num_bins) {
        carried = c;
        continue;
      }
      carried = {};
      if (!(c[0] > 0) || !(c[0] < 1e30) || area <= 0 || (bin - 0.5) * width > static_cast<double>(num_samples)) continue;
      Node& node = nodes_[static_cast<std::size_t>(band) * static_cast<std::size_t>(num_bins) + static_cast<std::size_t>(bin)];
      node.density = static_cast<float>(c[0] / area);
      double square = 0;
      for (std::size_t j = 0; j < 3; ++j) square += c[j + 1] * c[j + 1] / (c[0] * c[0]);
      if (!(square >= 0)) continue;
      const double limit = square > 3.0 ? std::sqrt(3.0 / square) : 1.0;  // rounding may point a single ray past its own energy
      for (std::size_t j = 0; j < 3; ++j) node.m[j] = static_cast<float>(limit * c[j + 1] / c[0]);
      node.d = static_cast<float>(std::sqrt(std::max(0.0, 1.0 - std::min(square, 3.0) / 3.0)));
    }
  }
}

std::size_t LateSynthesizer::render(const EnergyHistogram& energy, const CarrierBank& carriers, std::size_t offset, double onset_sample,
                                    std::span<const std::span<float>> channels) {
  const auto num_channels = static_cast<std::size_t>(carriers.num_channels());
  EARSHOT_EXPECT(channels.size() == num_channels && (num_channels == 1 || num_channels == 4));
  const std::size_t num_samples = channels[0].size();
  for (const auto& channel : channels) std::fill(channel.begin(), channel.end(), 0.f);
  const int num_bins = energy.num_bins(), num_bands = energy.num_bands();
  if (num_bins == 0) return 0;
  make_nodes(energy, onset_sample, num_samples);

  const double width = static_cast<double>(energy.bin_s()) * rate_hz_;
  const auto clamp_sample = [&](double position) {
    return static_cast<std::size_t>(std::clamp(std::ceil(position), 0.0, static_cast<double>(num_samples)));
  };
  const std::size_t onset = clamp_sample(onset_sample);
  std::size_t end_of_sound = 0;
  // Stretches between bin centres; before the first and after the last centre the density stays.
  for (int stretch = 0; stretch <= num_bins; ++stretch) {
    const double from = stretch == 0 ? 0.0 : (stretch - 0.5) * width, to = stretch == num_bins ? num_bins * width : (stretch + 0.5) * width;
    const std::size_t end = clamp_sample(to);
    for (std::size_t begin = std::max(clamp_sample(from), onset); begin < end;) {
      const std::size_t in_loop = (offset + begin) % carriers.length();
      const auto count = static_cast<int>(std::min(end - begin, carriers.length() - in_loop));
      const double share = (static_cast<double>(begin) - (stretch - 0.5) * width) / width;
      for (int band = 0; band < num_bands; ++band) {
        const Node* row = nodes_.data() + static_cast<std::size_t>(band) * static_cast<std::size_t>(num_bins);
        const Node &a = row[std::max(stretch - 1, 0)], &b = row[std::min(stretch, num_bins - 1)];
        if (a.density == 0.f && b.density == 0.f) continue;
        end_of_sound = begin + static_cast<std::size_t>(count);
        const auto ramp = [&](float left, float right) {
          return Ramp{static_cast<float>(left + share * (static_cast<double>(right) - left)),
                      static_cast<float>((static_cast<double>(right) - left) / width)};
        };
        const Ramp density = ramp(a.density, b.density);
        if (num_channels == 1) {
          add_omni(count, density, carriers.loop(band, 0).data() + in_loop, channels[0].data() + begin);
          continue;
        }
        // A silent end has no direction of its own.
        const Node &left = a.density > 0.f ? a : b, &right = b.density > 0.f ? b : a;
        const auto carrier = [&](int c) { return carriers.loop(band, c).data() + in_loop; };
        const auto out = [&](std::size_t c) { return channels[c].data() + begin; };
        const FirstOrderRamps ramps{density, ramp(left.m[0], right.m[0]), ramp(left.m[1], right.m[1]), ramp(left.m[2], right.m[2]),
                                    ramp(left.d, right.d)};
        add_first_order(count, ramps, carrier(0), carrier(1), carrier(2), carrier(3), out(0), out(1), out(2), out(3));
      }
      begin += static_cast<std::size_t>(count);
    }
  }
  return end_of_sound;
}

}  // namespace earshot
