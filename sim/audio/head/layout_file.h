// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <string_view>

namespace earshot {

/// Whether ListenerLayout::named opens a file for this text: array:FILE, or mono:FILE with a balloon.  Looks at the text alone.
bool names_file(std::string_view channels);

}  // namespace earshot
