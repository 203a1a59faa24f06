// SPDX-License-Identifier: Apache-2.0
#include "sim/acoustics/response/retarded_source.h"

#include <algorithm>
#include <cmath>
#include <glm/geometric.hpp>

#include "sim/acoustics/core/arrival.h"

namespace earshot {
namespace {

/// The delay with c delay = length_m(delay), from a first guess: each round leaves the Mach number of the error before.
template <class Length>
double retarded_delay_s(double guess_s, double speed_of_sound_m_per_s, const Length& length_m) {
  constexpr int most_rounds = 200;
  constexpr double close_enough_s = 1e-13;
  double delay_s = guess_s;
  for (int round = 0; round < most_rounds; ++round) {
    const double next_s = length_m(delay_s) / speed_of_sound_m_per_s;
    const bool settled = std::fabs(next_s - delay_s) < close_enough_s;
    delay_s = next_s;
    if (settled) break;
  }
  return delay_s;
}

}  // namespace

double emission_time_s(const SourcePlaceAt& place, glm::dvec3 listener, double heard_s, double speed_of_sound_m_per_s) {
  return heard_s -
         retarded_delay_s(0, speed_of_sound_m_per_s, [&](double delay_s) { return glm::distance(listener, place(heard_s - delay_s)); });
}

void retard_arrivals(const SourcePlaceAt& place, double emitted_s, double heard_s, EnergyResponse& response) {
  const double c{response.speed_of_sound_m_per_s};
  const glm::dvec3 emitted_from = place(emitted_s);
  for (Arrival& arrival : response.arrivals) {
    const double length_m{arrival.distance_m};
    const glm::dvec3 departure = arrival.departure;
    // A mirror keeps lengths and angles: between the image and the listener they are those between the source and its departing ray.
    const double delay_s = retarded_delay_s(length_m / c, c, [&](double delay) {
      const glm::dvec3 moved = place(heard_s - delay) - emitted_from;
      const double square = length_m * length_m - 2 * length_m * glm::dot(departure, moved) + glm::dot(moved, moved);
      return std::max(std::sqrt(std::max(square, 0.0)), double{kMinDistanceM});
    });
    arrival.distance_m = static_cast<float>(c * delay_s);
    const auto nearer = static_cast<float>(length_m / (c * delay_s));
    for (float& amplitude : arrival.amplitude) amplitude *= nearer;
  }
  std::ranges::stable_sort(response.arrivals, {}, &Arrival::distance_m);
}

}  // namespace earshot
