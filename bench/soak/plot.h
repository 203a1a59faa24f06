// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <string>

#include "bench/soak/soak.h"

namespace earshot {

/// Four pictures of a soak: memory over steps with its slope, milliseconds of a step by stage and percentile, episodes and scenes over
/// time.
std::string soak_svg(const SoakResult& result);

}  // namespace earshot
