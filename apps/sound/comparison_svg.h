// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <string>

#include "datasets/measured/room_comparison.h"

namespace earshot {

/// Decay times and direct-to-reverberant ratios of every place over the octaves, and the decay curves of up to twelve places, spread evenly
/// over the list: measured solid, simulated dashed.  A self-contained SVG.
std::string comparison_svg(const std::string& title, const RoomComparison& comparison);

}  // namespace earshot
