// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstddef>
#include <string>
#include <string_view>

namespace earshot {

inline constexpr std::size_t kMaxJsonDepth = 256;

/// Levels of lists and maps within each other in a JSON text; texts in quotes do not count.  The text need not be valid.  One pass, 1 GB/s.
std::size_t json_depth(std::string_view text);

/// Throws InputError naming `where` if the text nests deeper than kMaxJsonDepth, and so than any format of Earshot: a parser spends up to a
/// hundred bytes on a bracket, and code that walks the result recurses once per level, so a file of brackets alone would end the program.
void check_json_depth(std::string_view text, const std::string& where);

}  // namespace earshot
