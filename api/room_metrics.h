// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "earshot/metrics.h"
#include "sim/acoustics/metrics/room_metrics.h"

namespace earshot::api {

/// The same numbers, NaN for missing values.
Metrics metrics_of(const RoomMetrics& metrics);

}  // namespace earshot::api
