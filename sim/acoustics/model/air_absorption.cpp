// SPDX-License-Identifier: Apache-2.0
#include "sim/acoustics/model/air_absorption.h"

#include <cmath>
#include <numbers>

namespace earshot {

AirCurve air_curve(const Air& air) {
  constexpr double reference_k = 293.15, triple_point_k = 273.16, reference_kpa = 101.325;
  const double temperature_k = air.temperature_c + 273.15;
  const double ratio = temperature_k / reference_k;
  const double pressure = air.pressure_kpa / reference_kpa;

  // Saturation pressure and molar concentration of water vapour in per cent: annex B, eqs. B.1 to B.3.
  const double saturation = std::pow(10.0, -6.8346 * std::pow(triple_point_k / temperature_k, 1.261) + 4.6151);
  const double vapour = air.humidity_percent * saturation / pressure;

  // Relaxation frequencies of oxygen and nitrogen: eqs. 3 and 4.
  const double oxygen_hz = pressure * (24.0 + 4.04e4 * vapour * (0.02 + vapour) / (0.391 + vapour));
  const double nitrogen_hz = pressure / std::sqrt(ratio) * (9.0 + 280.0 * vapour * std::exp(-4.170 * (std::pow(ratio, -1.0 / 3.0) - 1.0)));

  // Eq. 5.
  return {.classical = 1.84e-11 / pressure * std::sqrt(ratio),
          .relaxation = std::pow(ratio, -2.5),
          .oxygen = 0.01275 * std::exp(-2239.1 / temperature_k),
          .oxygen_hz = oxygen_hz,
          .nitrogen = 0.1068 * std::exp(-3352.0 / temperature_k),
          .nitrogen_hz = nitrogen_hz};
}

double air_absorption_db_per_m(const Air& air, double frequency_hz) { return air_curve(air).db_per_m(frequency_hz); }

double air_absorption_energy_per_m(const Air& air, double frequency_hz) {
  return air_absorption_db_per_m(air, frequency_hz) * std::numbers::ln10 / 10.0;
}

}  // namespace earshot
