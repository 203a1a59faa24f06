// SPDX-License-Identifier: Apache-2.0
#include "bench/accuracy/shoebox_images.h"

#include <algorithm>
#include <cmath>
#include <complex>
#include <numbers>

#include "sim/acoustics/metrics/octave_filter.h"
#include "sim/audio/transforms/fft.h"
#include "sim/base/errors.h"

namespace earshot {
namespace {

constexpr double kBinS = 1e-3, kDirectWindowS = 2.5e-3;

/// One coordinate of an image and what the two walls across it have left of its energy.
struct AxisImage {
  double offset_m;
  std::vector<double> kept;  ///< per band
};

/// Image n lies at n L + s (even n) or n L + L - s (odd n) and has met |n| walls, in turn; the first is x1 for n > 0 and x0 for n < 0.
std::vector<AxisImage> images_along(double length_m, double source_m, double listener_m, double reach_m,
                                    const std::vector<double>& absorption_0, const std::vector<double>& absorption_1) {
  std::vector<AxisImage> images;
  const int most = static_cast<int>(reach_m / length_m) + 2;
  for (int n = -most; n <= most; ++n) {
    const int first = (std::abs(n) + 1) / 2, second = std::abs(n) / 2, of_1 = n > 0 ? first : second, of_0 = n > 0 ? second : first;
    AxisImage& image = images.emplace_back();
    image.offset_m = n * length_m + (n % 2 == 0 ? source_m : length_m - source_m) - listener_m;
    for (std::size_t b = 0; b < absorption_0.size(); ++b)
      image.kept.push_back(std::pow(1 - absorption_0[b], of_0) * std::pow(1 - absorption_1[b], of_1));
  }
  return images;
}

/// Source to listener.
double direct_distance(const ShoeboxRoom& room, std::size_t listener) {
  const glm::dvec3 to_source = room.source_m - room.listeners_m.at(listener);
  const double direct_m = std::sqrt(to_source.x * to_source.x + to_source.y * to_source.y + to_source.z * to_source.z);
  require(direct_m > 0, "distance from source to listener", direct_m, "must be positive");
  return direct_m;
}

/// Calls use(distance, energies per band) for every image whose sound arrives within the length.
template <class Use>
void for_images(const ShoeboxRoom& room, std::size_t listener, const Use& use) {
  const glm::dvec3 at = room.listeners_m.at(listener);
  const double reach_m = room.length_s * room.speed_of_sound_m_per_s;
  const std::size_t bands = room.bands_hz.size();
  require(BandLayout::octaves(static_cast<float>(room.sample_rate_hz)).centre_hz.size() == bands, "bands", bands,
          "must be the octaves of the sample rate");
  for (const auto& wall : room.absorption)
    require(wall.size() == bands, "absorption values of a wall", wall.size(), "must be one per band");
  std::array<std::vector<AxisImage>, 3> axes;
  for (std::size_t axis = 0; axis < 3; ++axis) {
    const auto a = static_cast<glm::dvec3::length_type>(axis);
    axes[axis] = images_along(room.size_m[a], room.source_m[a], at[a], reach_m, room.absorption[2 * axis], room.absorption[2 * axis + 1]);
  }
  std::vector<double> product(bands), energy(bands);
  const double per_area = 1 / (16 * std::numbers::pi * std::numbers::pi);
  for (const AxisImage& x : axes[0])
    for (const AxisImage& y : axes[1]) {
      const double level_2 = x.offset_m * x.offset_m + y.offset_m * y.offset_m;
      if (level_2 >= reach_m * reach_m) continue;
      for (std::size_t b = 0; b < bands; ++b) product[b] = per_area * x.kept[b] * y.kept[b];
      for (const AxisImage& z : axes[2]) {
        const double r_2 = level_2 + z.offset_m * z.offset_m;
        if (r_2 >= reach_m * reach_m) continue;
        for (std::size_t b = 0; b < bands; ++b) energy[b] = product[b] * z.kept[b] / r_2;
        use(std::sqrt(r_2), energy);
      }
    }
}

}  // namespace

RoomMetrics measure_images(const ShoeboxRoom& room, std::size_t listener) {
  const double direct_m = direct_distance(room, listener), speed = room.speed_of_sound_m_per_s;
  const std::size_t bands = room.bands_hz.size();
  require(room.length_s > direct_m / speed, "length_s", room.length_s, "must be longer than the delay of the direct sound");
  const auto bins = static_cast<std::size_t>(std::ceil((room.length_s - direct_m / speed) / kBinS));
  std::vector<std::vector<double>> series(bands, std::vector<double>(bins, 0.0));
  std::vector<double> direct(bands, 0.0);
  for_images(room, listener, [&](double distance_m, const std::vector<double>& energy) {
    const double after_s = std::max(distance_m - direct_m, 0.0) / speed;
    const auto bin = std::min(static_cast<std::size_t>(after_s / kBinS), bins - 1);
    for (std::size_t b = 0; b < bands; ++b) (after_s <= kDirectWindowS ? direct[b] : series[b][bin]) += energy[b];
  });

  RoomMetrics metrics;
  metrics.bands_hz = room.bands_hz;
  metrics.direct_delay_s = direct_m / speed;
  const BandLayout layout = BandLayout::octaves(static_cast<float>(room.sample_rate_hz));
  double direct_sum = 0, rest_sum = 0;
  for (std::size_t b = 0; b < bands; ++b) {
    metrics.bands.push_back(measure_band(series[b], kBinS, direct[b]));
    // Sources have equal energy per hertz; the lowest band stands for what lies below it too.
    const double width_hz = double{layout.edge_hz[b + 1]} - (b == 0 ? 0.0 : double{layout.edge_hz[b]});
    direct_sum += width_hz * direct[b];
    for (const double energy : series[b]) rest_sum += width_hz * energy;
  }
  metrics.drr_db = level_ratio_db(direct_sum, rest_sum);
  return metrics;
}

std::vector<float> render_images(const ShoeboxRoom& room, std::size_t listener) {
  constexpr int oversampling = 8;
  const auto samples = static_cast<std::size_t>(std::lround(room.length_s * room.sample_rate_hz));
  // Twice the length: the ringing of the filters before time zero wraps to the end and is cut off.
  RealFft fine(next_power_of_two(static_cast<int>(2 * samples * oversampling))), coarse(fine.size() / oversampling);
  const std::size_t bands = room.bands_hz.size();
  std::vector<std::vector<float>> trains(bands, std::vector<float>(samples * oversampling + oversampling, 0.f));
  const double per_m = room.sample_rate_hz * oversampling / room.speed_of_sound_m_per_s;
  for_images(room, listener, [&](double distance_m, const std::vector<double>& energy) {
    const auto at = static_cast<std::size_t>(std::lround(distance_m * per_m));
    for (std::size_t b = 0; b < bands; ++b) trains[b][at] += static_cast<float>(std::sqrt(energy[b]));
  });
  const BandLayout layout = BandLayout::octaves(static_cast<float>(room.sample_rate_hz));
  const double nyquist_hz = 0.5 * room.sample_rate_hz;
  std::vector<std::complex<float>> spectrum(static_cast<std::size_t>(fine.num_bins())), sum(static_cast<std::size_t>(coarse.num_bins()));
  for (std::size_t b = 0; b < bands; ++b) {
    fine.forward(trains[b], spectrum);
    for (std::size_t k = 0; k < sum.size(); ++k) {
      const double hz = static_cast<double>(k) * room.sample_rate_hz / coarse.size();
      const double gain = octave_gain(layout, static_cast<int>(b), hz, nyquist_hz);
      sum[k] += static_cast<float>(gain * gain) * spectrum[k];  // power-complementary gains, squared: amplitudes add up to one
    }
  }
  std::vector<float> response(static_cast<std::size_t>(coarse.size()));
  coarse.inverse(sum, response);
  response.resize(samples);
  return response;
}

}  // namespace earshot
