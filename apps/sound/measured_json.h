// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <nlohmann/json_fwd.hpp>

#include "datasets/measured/material_fit.h"
#include "datasets/measured/room_comparison.h"

namespace earshot {

/// bands_hz, mean (errors and biases) and places, with both sides by octave; null where there is no value.
nlohmann::ordered_json comparison_json(const RoomComparison& comparison);
/// The means alone.
nlohmann::ordered_json means_json(const RoomComparison& comparison);
/// bands_hz, materials with their coefficients and standard errors, misfit before and after.
nlohmann::ordered_json fit_json(const FittedRoom& fitted);

}  // namespace earshot
