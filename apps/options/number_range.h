// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <string>
#include <vector>

namespace earshot {

/// "LOW,HIGH", or "X" for both, with a decimal point whatever the locale.  Two finite numbers.  Throws InputError naming the option.
std::vector<float> parse_range(const std::string& text, const std::string& option);

}  // namespace earshot
