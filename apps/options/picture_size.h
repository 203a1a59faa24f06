// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <string>
#include <utility>

namespace earshot {

/// The text of an option, "WIDTHxHEIGHT": two positive numbers of pixels.  Throws InputError that names the option and `example`.
std::pair<int, int> parse_picture_size(const std::string& text, const std::string& example, const std::string& option = "--size");

}  // namespace earshot
