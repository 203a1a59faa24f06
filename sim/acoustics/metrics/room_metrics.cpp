#include "sim/acoustics/metrics/room_metrics.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <numbers>

namespace earshot {
namespace {

/// Adds `energy` spread evenly over [begin_s, begin_s + width_s) to a series of bins that starts at zero; what lies before goes to bin 0.
void add_spread(std::vector<double>& series, double bin_s, double begin_s, double width_s, double energy) {
  const auto last = static_cast<double>(series.size());
  const double from = begin_s / bin_s, to = (begin_s + width_s) / bin_s;
  const double low = std::clamp(from, 0.0, last), high = std::clamp(to, 0.0, last);
  if (from < 0) series[0] += energy * (std::min(to, 0.0) - from) / (to - from);
  for (auto i = static_cast<std::size_t>(low); static_cast<double>(i) < high; ++i) {
    const double overlap = std::min(high, static_cast<double>(i + 1)) - std::max(low, static_cast<double>(i));
    series[i] += energy * overlap / (to - from);
  }
}

/// Energy of direct and diffracted sound together in a band from low_hz to high_hz, flat within it: sum over all pairs of a_i a_j times the
/// band mean of cos(2 pi f t + p), t and p their differences in time and phase, which is cos(2 pi f_mid t + p) sinc(bandwidth t).
double coherent_energy(std::span<const Arrival> arrivals, int band, double low_hz, double high_hz, double speed_m_per_s) {
  const auto interferes = [](const Arrival& arrival) {
    return arrival.kind == ArrivalKind::direct || arrival.kind == ArrivalKind::diffraction;
  };
  double sum = 0;
  for (std::size_t i = 0; i < arrivals.size(); ++i) {
    if (!interferes(arrivals[i])) continue;
    const double own = arrivals[i].amplitude[band];
    sum += own * own;
    for (std::size_t j = 0; j < i; ++j) {
      if (!interferes(arrivals[j])) continue;
      const double apart_s = (double{arrivals[i].distance_m} - arrivals[j].distance_m) / speed_m_per_s;
      const double phase = double{arrivals[j].phase_rad[band]} - arrivals[i].phase_rad[band];
      const double half_turns = std::numbers::pi * (high_hz - low_hz) * apart_s;
      const double sinc = std::abs(half_turns) > 1e-6 ? std::sin(half_turns) / half_turns : 1.0;
      sum += 2.0 * own * arrivals[j].amplitude[band] * std::cos(std::numbers::pi * (low_hz + high_hz) * apart_s + phase) * sinc;
    }
  }
  return std::max(sum, 0.0);
}

/// Fraction of diffracted sound that belongs to the direct sound: all within 1.5 ms, none after the 2.5 ms that count as direct in a RIR.
double direct_fraction(double after_s) {
  const double x = std::clamp((after_s - 1.5e-3) / 1e-3, 0.0, 1.0);
  return 0.5 + 0.5 * std::cos(std::numbers::pi * x);
}

}  // namespace

RoomMetrics measure(const AcousticScene& scene, const EnergyResponse& response) {
  const double speed = scene.speed_of_sound_m_per_s();
  const EnergyHistogram& late = response.late;
  const double late_bin_s = late.bin_s();
  RoomMetrics metrics;
  metrics.bands_hz = scene.bands().centre_hz;

  // Time zero.
  double start_s = std::numeric_limits<double>::infinity();
  // Rounding may put sound diffracted on the shadow boundary before the direct sound.
  const bool has_direct = std::any_of(response.arrivals.begin(), response.arrivals.end(),
                                      [](const Arrival& arrival) { return arrival.kind == ArrivalKind::direct; });
  if (!response.arrivals.empty()) start_s = response.arrivals.front().distance_m / speed;
  if (has_direct) {
    metrics.direct_delay_s = start_s;
  } else {
    for (int bin = 0; bin < late.num_bins(); ++bin) {
      double energy = 0;
      for (int band = 0; band < late.num_bands(); ++band) energy += late.energy(bin, band);
      if (energy > 0) {
        start_s = std::min(start_s, bin * late_bin_s);
        break;
      }
    }
  }
  const bool has_diffraction = std::any_of(response.arrivals.begin(), response.arrivals.end(),
                                           [](const Arrival& arrival) { return arrival.kind == ArrivalKind::diffraction; });
  metrics.bands.resize(scene.num_bands());
  if (!std::isfinite(start_s)) return metrics;  // silence

  // Bins of about a millisecond from time zero on; a late bin is spread evenly over its width.
  const int parts = std::max(1, static_cast<int>(std::ceil(late_bin_s / 1e-3 - 1e-6)));
  const double bin_s = late_bin_s / parts;
  const double length_s = scene.config().rir_length_s - start_s;
  const auto num_bins = static_cast<std::size_t>(std::max(1.0, std::ceil(length_s / bin_s)));
  double direct_sum = 0, reverberant_sum = 0, bandwidth_sum = 0;
  for (int band = 0; band < scene.num_bands(); ++band) {
    std::vector<double> series(num_bins, 0.0);
    // Fraction of its own energy that the diffracted sound has in the interference of all paths: as the direct sound's part if there is
    // one.
    double direct = 0, diffracted_fraction = 1;
    if (has_diffraction) {
      const double together = coherent_energy(response.arrivals, band, scene.bands().edge_hz[band], scene.bands().edge_hz[band + 1], speed);
      double apart = 0;
      for (const Arrival& arrival : response.arrivals) {
        if (arrival.kind != ArrivalKind::diffraction) continue;
        const double fraction = has_direct ? 1.0 - direct_fraction(arrival.distance_m / speed - start_s) : 1.0;
        apart += fraction * arrival.amplitude[band] * arrival.amplitude[band];
      }
      if (has_direct)
        direct = std::max(together - apart, 0.0);
      else if (apart > 0)
        diffracted_fraction = together / apart;
    }
    for (const Arrival& arrival : response.arrivals) {
      double energy = double{arrival.amplitude[band]} * arrival.amplitude[band];
      if (arrival.kind == ArrivalKind::direct) {
        if (!has_diffraction) direct += energy;
        continue;
      }
      if (arrival.kind == ArrivalKind::diffraction) {
        energy *= has_direct ? 1.0 - direct_fraction(arrival.distance_m / speed - start_s) : diffracted_fraction;
      }
      const double position = (arrival.distance_m / speed - start_s) / bin_s;
      if (position < static_cast<double>(num_bins)) series[static_cast<std::size_t>(std::max(position, 0.0))] += energy;
    }
    for (int bin = 0; bin < late.num_bins(); ++bin) {
      const double energy = late.energy(bin, band);
      if (energy > 0) add_spread(series, bin_s, bin * late_bin_s - start_s, late_bin_s, energy);
    }
    metrics.bands[band] = measure_band(series, bin_s, direct);

    const double bandwidth = scene.bands().edge_hz[band + 1] - scene.bands().edge_hz[band];
    direct_sum += bandwidth * direct;
    for (const double energy : series) reverberant_sum += bandwidth * energy;
    bandwidth_sum += bandwidth;
  }
  metrics.drr_db = level_ratio_db(direct_sum, reverberant_sum);
  if (has_direct) metrics.direct_amplitude = std::sqrt(direct_sum / bandwidth_sum);
  return metrics;
}

}  // namespace earshot
