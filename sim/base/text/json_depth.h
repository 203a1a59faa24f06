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

/// Throws InputError "where:line: a.b is given twice, in lines 3 and 7; keep one of the two" for the first key that an object of a JSON
/// text has twice: parsers keep one of its values and say nothing.  For files that people write; the text is valid.
void check_unique_keys(std::string_view text, const std::string& where);

}  // namespace earshot
