// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>

namespace earshot {

/// Actions of an agent.  The numbers are part of result files.
enum class Action : std::int32_t { stop = 0, forward = 1, left = 2, right = 3 };
inline constexpr int kNumActions = 4;

}  // namespace earshot
