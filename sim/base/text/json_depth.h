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

/// Offset of the first NUL byte that anything but NUL bytes follows; npos: there is none.  To nlohmann's parser the text ends there, and
/// the rest would be left out in silence.  NUL bytes at the end are padding.
[[nodiscard]] std::size_t nul_within_json(std::string_view text);
/// Throws InputError where there is one.
void check_no_nul(std::string_view text, const std::string& where);

}  // namespace earshot
