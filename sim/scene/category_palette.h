// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <vector>

namespace earshot {

/// What the numbers of a category picture look like, [category_names(), 3] encoded sRGB: black for unknown, else a colour of the name.
std::vector<std::uint8_t> category_palette();

}  // namespace earshot
