// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "sim/acoustics/core/air_loss.h"
#include "sim/scene/scene.h"

namespace earshot {

/// Terms of the attenuation in this air (ISO 9613-1:1993, eqs. 3 to 5).  air: ranges as in its declaration.
AirCurve air_curve(const Air& air);
/// Attenuation of a plane wave in air in dB per metre (ISO 9613-1:1993, eqs. 3 to 5).  Within 0.1 % of docs/evidence/oracles.md, O-23.
/// air: ranges as in its declaration.  frequency_hz > 0.  Cost: about 0.3 us.
double air_absorption_db_per_m(const Air& air, double frequency_hz);
/// The same as an energy exponent: energy falls as exp(-m r).  m = dB / 4.342945.
double air_absorption_energy_per_m(const Air& air, double frequency_hz);

}  // namespace earshot
