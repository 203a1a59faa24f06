// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <string_view>

namespace earshot {

/// RFC 3629: whole sequences, none longer than it need be, no surrogates, nothing above U+10FFFF.  No zero byte either, which no text has.
bool is_utf8(std::string_view text);

}  // namespace earshot
