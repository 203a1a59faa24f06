// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <string>
#include <string_view>

namespace earshot {

/// Throws InputError "where:line: a.b is given twice, in lines 3 and 7; keep one of the two" for the first key that an object of a JSON
/// text has twice, where parsers keep one value in silence.  The text must be valid JSON.  For files that people write.
void check_unique_keys(std::string_view text, const std::string& where);

}  // namespace earshot
