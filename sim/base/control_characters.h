// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <string>
#include <string_view>

namespace earshot {

/// Whether a UTF-8 text holds what a terminal or a page does not show but obeys: the control characters of ASCII and of Latin-1 (escape
/// sequences begin with them), marks and overrides of the direction of writing, line and paragraph separators.  Bytes that are not UTF-8
/// and lie where those of Latin-1 do count too.
bool has_control_character(std::string_view text);

/// The text with a blank in the place of each of them.
std::string printable(std::string_view text);

}  // namespace earshot
