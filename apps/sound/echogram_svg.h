// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <string>

#include "sim/acoustics/response/energy_response.h"

namespace earshot {

/// A picture of an energy response, as a self-contained SVG.  Above, at the band nearest 1 kHz: each path as a stem coloured by its kind,
/// and the late field as energy per millisecond, both in dB relative to the loudest path (or late millisecond).  Below: the energy decay
/// curve of every band.  Time counts from emission, up to where the slowest decay passes -60 dB.
std::string echogram_svg(const std::string& title, const AcousticScene& scene, const EnergyResponse& response);

}  // namespace earshot
