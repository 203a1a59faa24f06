// SPDX-License-Identifier: Apache-2.0
#include "apps/options/picture_size.h"

#include <charconv>

#include "sim/base/errors.h"

namespace earshot {

std::pair<int, int> parse_picture_size(const std::string& text, const std::string& example, const std::string& option) {
  int width = 0, height = 0;
  const char* const end = text.data() + text.size();
  const auto [cross, wrong_width] = std::from_chars(text.data(), end, width);
  if (wrong_width == std::errc() && cross != end && *cross == 'x') {
    const auto [last, wrong_height] = std::from_chars(cross + 1, end, height);
    if (wrong_height == std::errc() && last == end && width > 0 && height > 0) return {width, height};
  }
  throw InputError(option + " " + text, "is not a size", "write WIDTHxHEIGHT in pixels: " + example);
}

}  // namespace earshot
