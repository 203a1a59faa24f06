// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <glm/vec3.hpp>
#include <span>
#include <vector>

#include "sim/acoustics/core/bands.h"
#include "sim/acoustics/response/energy_response.h"

namespace earshot {

/// Time zero of a response, and the times of its arrivals from there on: the direct arrival, or, without line of sight, the first arrival
/// of any kind.
struct TimeZero {
  TimeZero(const EnergyResponse& response, double speed_m_per_s);
  [[nodiscard]] double after_s(const Arrival& arrival) const { return arrival.distance_m / speed_m_per_s - start_s; }
  /// Fraction of a diffracted arrival that does not belong to the direct sound.
  [[nodiscard]] double reverberant_fraction(const Arrival& arrival) const;

  double speed_m_per_s;
  bool has_direct, has_diffraction;
  double start_s;  ///< infinity: silence
};

/// Direct sound of one band with what diffraction adds to it.
struct FirstSound {
  double direct = 0;               ///< energy
  double diffracted_fraction = 1;  ///< of its own energy that diffracted sound has where there is no direct sound
};
/// Interference of all paths with diffraction goes to the direct sound, or to the diffracted sound if there is none.
FirstSound first_sound(const TimeZero& zero, std::span<const Arrival> arrivals, const BandLayout& bands, int band);

/// Bins of about a millisecond from time zero on.
struct SeriesBins {
  double bin_s;
  std::size_t count;
};
SeriesBins series_bins(double late_bin_s, double length_s);

/// Weight of energy by the angle between its arrival direction and an axis: exact for arrivals, by harmonics for the late field.
class AxisWeight {
 public:
  enum class Kind {
    squared_cosine,  ///< of a figure-of-eight microphone; exact from harmonics of order 2
    cosine           ///< size of the cosine; up to 0.12 off for a single direction with harmonics of order 4, right in a diffuse field
  };
  /// axis: unit.  num_coefficients: of the late field; harmonics of higher order than the weight has are left out.
  AxisWeight(Kind kind, glm::vec3 axis, int num_coefficients);
  [[nodiscard]] double of_direction(glm::vec3 direction) const;
  /// Weighted energy of one bin and band of the late field, >= 0.
  [[nodiscard]] double energy(std::span<const float> coefficients) const;
  /// Order of harmonics without which the late field has no weighted energy.
  [[nodiscard]] static int needed_order(Kind kind) { return kind == Kind::squared_cosine ? 2 : 4; }

 private:
  Kind kind_;
  glm::vec3 axis_;
  std::vector<double> factor_;  ///< of each coefficient
};

/// Energy of one band over time without the direct sound; a late bin is spread evenly over its width.  weight: null counts all alike.
std::vector<double> reverberant_series(const EnergyResponse& response, const TimeZero& zero, int band, double diffracted_fraction,
                                       const SeriesBins& bins, const AxisWeight* weight = nullptr);

}  // namespace earshot
