// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <string>
#include <string_view>

namespace earshot {

/// The text as HTML or XML shows it, between tags or within double quotes.  Control characters stay as they are.
std::string escape_markup(std::string_view text);

}  // namespace earshot
