// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <functional>
#include <glm/vec3.hpp>
#include <memory>
#include <span>
#include <string>
#include <vector>

#include "sim/audio/head/directivity.h"

namespace earshot {

/// Writes the pressure in one direction at each frequency, any scale per frequency; negative where the polarity is turned.
using PressureByDirection = std::function<void(glm::vec3 direction, std::span<double> pressure)>;

/// A pattern on the nodes of AngleGrid, made relative to the front of each frequency, bilinear in pressure between nodes.  At a frequency
/// linear in magnitude over log frequency, with the sign of the nearer line; the end values hold outside.  Over a band with two lines or
/// more the root of the mean squared gain over its hertz, each line counting as far as the geometric means with its neighbours; with fewer
/// lines the gain at its centre.  The mean has the sign of the greater power if its lines agree on it to seven eighths of the power in all
/// directions that are within 20 dB of the loudest; else it has none, as a change of sign between two nodes would cut a zero into it.
/// frequency_hz: rising.  Throws InputError naming `where` if the front is 60 dB or more below another direction, as nothing can be
/// relative to it.
std::shared_ptr<const Directivity> directivity_on_grid(std::vector<double> frequency_hz, const PressureByDirection& pressure,
                                                       const std::string& where);

}  // namespace earshot
