// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "earshot/metrics.h"
#include "sim/acoustics/metrics/room_metrics.h"

namespace earshot::api {

/// The same numbers, NaN for missing values.
Metrics metrics_of(const RoomMetrics& metrics);

/// @throws InputError for an unknown group or a bad ratio.
ParameterRequest request_of(const ParameterOptions& parameters);

}  // namespace earshot::api
