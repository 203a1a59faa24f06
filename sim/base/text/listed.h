// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <fmt/format.h>

#include <string>
#include <string_view>

namespace earshot {

/// The elements of a range as fmt writes them, with the separator between them.  fmt::join would compile the formatting of numbers into
/// each source that calls it, two and a half seconds.
template <class Range>
[[nodiscard]] std::string listed(const Range& range, std::string_view separator) {
  std::string text;
  bool first = true;
  for (const auto& element : range) {
    text += fmt::format("{}{}", first ? "" : separator, element);
    first = false;
  }
  return text;
}

}  // namespace earshot
