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

/// A pattern on the grid of 5 degrees that BandDirectivity has, made relative to the front of each frequency.  Between nodes bilinear in
/// pressure; between frequencies linear in magnitude over log frequency, with the sign of the nearer one; the end values hold outside.
/// frequency_hz: rising.  Throws InputError naming `where` if the front is 60 dB or more below another direction, as nothing can be
/// relative to it.
std::shared_ptr<const Directivity> directivity_on_grid(std::vector<double> frequency_hz, const PressureByDirection& pressure,
                                                       const std::string& where);

}  // namespace earshot
