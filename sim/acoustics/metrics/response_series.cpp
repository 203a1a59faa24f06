// SPDX-License-Identifier: Apache-2.0
#include "sim/acoustics/metrics/response_series.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <glm/geometric.hpp>
#include <limits>
#include <numbers>

#include "sim/audio/head/ambisonics.h"

namespace earshot {
namespace {

/// Adds `energy` spread evenly over [begin_s, begin_s + width_s) to a series of bins that starts at zero; earlier energy goes to bin 0.
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
    const double amplitude = arrivals[i].amplitude[band];
    sum += amplitude * amplitude;
    for (std::size_t j = 0; j < i; ++j) {
      if (!interferes(arrivals[j])) continue;
      const double apart_s = (double{arrivals[i].distance_m} - arrivals[j].distance_m) / speed_m_per_s;
      const double phase = double{arrivals[j].phase_rad[band]} - arrivals[i].phase_rad[band];
      const double half_turns = std::numbers::pi * (high_hz - low_hz) * apart_s;
      const double sinc = std::abs(half_turns) > 1e-6 ? std::sin(half_turns) / half_turns : 1.0;
      sum += 2.0 * amplitude * arrivals[j].amplitude[band] * std::cos(std::numbers::pi * (low_hz + high_hz) * apart_s + phase) * sinc;
    }
  }
  return std::max(sum, 0.0);
}

/// Fraction of diffracted sound that belongs to the direct sound: all within 1.5 ms, none after the 2.5 ms that count as direct in a RIR.
double direct_fraction(double after_s) {
  const double x = std::clamp((after_s - 1.5e-3) / 1e-3, 0.0, 1.0);
  return 0.5 + 0.5 * std::cos(std::numbers::pi * x);
}

bool has_kind(std::span<const Arrival> arrivals, ArrivalKind kind) {
  return std::any_of(arrivals.begin(), arrivals.end(), [&](const Arrival& arrival) { return arrival.kind == kind; });
}

/// Begin of the first late bin with energy; infinity if there is none.
double first_late_s(const EnergyHistogram& late) {
  for (int bin = 0; bin < late.num_bins(); ++bin) {
    double energy = 0;
    for (int band = 0; band < late.num_bands(); ++band) energy += late.energy(bin, band);
    if (energy > 0) return bin * double{late.bin_s()};
  }
  return std::numeric_limits<double>::infinity();
}

}  // namespace

TimeZero::TimeZero(const EnergyResponse& response, double speed)
    : speed_m_per_s(speed),
      has_direct(has_kind(response.arrivals, ArrivalKind::direct)),
      has_diffraction(has_kind(response.arrivals, ArrivalKind::diffraction)),
      start_s(std::numeric_limits<double>::infinity()) {
  // The first arrival of any kind: rounding may put sound diffracted on the shadow boundary before the direct sound.
  if (!response.arrivals.empty()) start_s = response.arrivals.front().distance_m / speed;
  if (!has_direct) start_s = std::min(start_s, first_late_s(response.late));
}

double TimeZero::reverberant_fraction(const Arrival& arrival) const { return has_direct ? 1.0 - direct_fraction(after_s(arrival)) : 1.0; }

FirstSound first_sound(const TimeZero& zero, std::span<const Arrival> arrivals, const BandLayout& bands, int band) {
  FirstSound first;
  if (!zero.has_diffraction) {
    for (const Arrival& arrival : arrivals)
      if (arrival.kind == ArrivalKind::direct) first.direct += double{arrival.amplitude[band]} * arrival.amplitude[band];
    return first;
  }
  const double together = coherent_energy(arrivals, band, bands.edge_hz[band], bands.edge_hz[band + 1], zero.speed_m_per_s);
  double apart = 0;
  for (const Arrival& arrival : arrivals) {
    if (arrival.kind != ArrivalKind::diffraction) continue;
    apart += zero.reverberant_fraction(arrival) * arrival.amplitude[band] * arrival.amplitude[band];
  }
  if (zero.has_direct)
    first.direct = std::max(together - apart, 0.0);
  else if (apart > 0)
    first.diffracted_fraction = together / apart;
  return first;
}

SeriesBins series_bins(double late_bin_s, double length_s) {
  const int parts = std::max(1, static_cast<int>(std::ceil(late_bin_s / 1e-3 - 1e-6)));
  const double bin_s = late_bin_s / parts;
  return {bin_s, static_cast<std::size_t>(std::max(1.0, std::ceil(length_s / bin_s)))};
}

AxisWeight::AxisWeight(Kind kind, glm::vec3 axis, int num_coefficients) : kind_(kind), axis_(axis) {
  // Weight = sum over l of c_l P_l(cos): cos^2 exactly, |cos| up to order 4 (Abramowitz and Stegun, 8.6 and 22.10).
  constexpr std::array<double, 5> squared{1.0 / 3, 0, 2.0 / 3, 0, 0}, size{0.5, 0, 0.625, 0, -0.1875};
  const std::array<double, 5>& legendre = kind == Kind::squared_cosine ? squared : size;
  std::array<float, kMaxCoefficients> harmonics{};
  spherical_harmonics_n3d(axis, 5, harmonics);
  for (int l = 0; l < 5 && (l + 1) * (l + 1) <= num_coefficients; ++l) {
    // Addition theorem of N3D harmonics: (2 l + 1) P_l(a b) = sum over m of Y_lm(a) Y_lm(b).
    for (int i = l * l; i < (l + 1) * (l + 1); ++i)
      factor_.push_back(legendre[static_cast<std::size_t>(l)] / (2.0 * l + 1.0) *
                        static_cast<double>(harmonics[static_cast<std::size_t>(i)]));
  }
}

double AxisWeight::of_direction(glm::vec3 direction) const {
  const double cosine = static_cast<double>(glm::dot(direction, axis_));
  return kind_ == Kind::squared_cosine ? cosine * cosine : std::abs(cosine);
}

double AxisWeight::energy(std::span<const float> coefficients) const {
  double sum = 0;
  for (std::size_t i = 0; i < factor_.size(); ++i) sum += factor_[i] * static_cast<double>(coefficients[i]);
  return std::max(sum, 0.0);
}

std::vector<double> reverberant_series(const EnergyResponse& response, const TimeZero& zero, int band, double diffracted_fraction,
                                       const SeriesBins& bins, const AxisWeight* weight) {
  std::vector<double> series(bins.count, 0.0);
  for (const Arrival& arrival : response.arrivals) {
    if (arrival.kind == ArrivalKind::direct) continue;
    double energy = double{arrival.amplitude[band]} * arrival.amplitude[band];
    if (arrival.kind == ArrivalKind::diffraction) energy *= zero.has_direct ? zero.reverberant_fraction(arrival) : diffracted_fraction;
    if (weight != nullptr) energy *= weight->of_direction(arrival.direction);
    const double position = zero.after_s(arrival) / bins.bin_s;
    if (position < static_cast<double>(bins.count)) series[static_cast<std::size_t>(std::max(position, 0.0))] += energy;
  }
  const double late_bin_s = response.late.bin_s();
  for (int bin = 0; bin < response.late.num_bins(); ++bin) {
    const double energy = weight == nullptr ? response.late.energy(bin, band) : weight->energy(response.late.at(bin, band));
    if (energy > 0) add_spread(series, bins.bin_s, bin * late_bin_s - zero.start_s, late_bin_s, energy);
  }
  return series;
}

}  // namespace earshot
