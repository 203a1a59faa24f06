// SPDX-License-Identifier: Apache-2.0
#pragma once

namespace earshot {

/// Listener poses per source for which the effect plan weighs the cost of a source field against tracing each response.
inline constexpr double kPosesPerSource = 300;

}  // namespace earshot
