// SPDX-License-Identifier: Apache-2.0
#pragma once

namespace earshot {

/// Ears are compared at lags up to this one.
inline constexpr double kMaxLagS = 1e-3;
/// The early part begins this long before the direct sound, and ends this long after it (ISO 3382-1: 80 ms).
inline constexpr double kBeforeDirectS = 2.5e-3, kEarlyS = 0.08;

}  // namespace earshot
