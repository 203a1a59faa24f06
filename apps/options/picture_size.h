// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <string>
#include <utility>

namespace earshot {

/// The text of --size, "WIDTHxHEIGHT": two positive numbers of pixels.  Throws InputError that names `example`.
std::pair<int, int> parse_picture_size(const std::string& text, const std::string& example);

}  // namespace earshot
