#include "bench/shoebox_images.h"

#include <cmath>
#include <numbers>

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

}  // namespace

RoomMetrics measure_images(const ShoeboxRoom& room, std::size_t listener) {
  const glm::dvec3 at = room.listeners_m.at(listener);
  const double reach_m = room.length_s * room.speed_of_sound_m_per_s;
  const std::size_t bands = room.bands_hz.size();
  for (const auto& wall : room.absorption)
    require(wall.size() == bands && bands > 0, "absorption values of a wall", wall.size(), "must be as many as bands");
  std::array<std::vector<AxisImage>, 3> axes;
  for (std::size_t axis = 0; axis < 3; ++axis) {
    const auto a = static_cast<glm::dvec3::length_type>(axis);
    axes[axis] = images_along(room.size_m[a], room.source_m[a], at[a], reach_m, room.absorption[2 * axis], room.absorption[2 * axis + 1]);
  }
  const glm::dvec3 to_source = room.source_m - at;
  const double direct_m = std::sqrt(to_source.x * to_source.x + to_source.y * to_source.y + to_source.z * to_source.z);
  require(direct_m > 0, "distance from source to listener", direct_m, "must be positive");

  const auto bins = static_cast<std::size_t>(std::ceil((room.length_s - direct_m / room.speed_of_sound_m_per_s) / kBinS));
  std::vector<std::vector<double>> series(bands, std::vector<double>(bins, 0.0));
  std::vector<double> direct(bands, 0.0), product(bands);
  const double per_area = 1 / (16 * std::numbers::pi * std::numbers::pi);
  for (const AxisImage& x : axes[0])
    for (const AxisImage& y : axes[1]) {
      const double level_2 = x.offset_m * x.offset_m + y.offset_m * y.offset_m;
      if (level_2 >= reach_m * reach_m) continue;
      for (std::size_t b = 0; b < bands; ++b) product[b] = per_area * x.kept[b] * y.kept[b];
      for (const AxisImage& z : axes[2]) {
        const double r_2 = level_2 + z.offset_m * z.offset_m;
        if (r_2 >= reach_m * reach_m) continue;
        const double after_s = (std::sqrt(r_2) - direct_m) / room.speed_of_sound_m_per_s;
        const auto bin = std::min(static_cast<std::size_t>(after_s / kBinS), bins - 1);
        for (std::size_t b = 0; b < bands; ++b) {
          const double energy = product[b] * z.kept[b] / r_2;
          (after_s <= kDirectWindowS ? direct[b] : series[b][bin]) += energy;
        }
      }
    }

  RoomMetrics metrics;
  metrics.bands_hz = room.bands_hz;
  metrics.direct_delay_s = direct_m / room.speed_of_sound_m_per_s;
  const BandLayout layout = BandLayout::octaves(static_cast<float>(room.sample_rate_hz));
  require(layout.centre_hz.size() == bands, "bands", bands, "must be the octaves of the sample rate");
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

}  // namespace earshot
