// SPDX-License-Identifier: Apache-2.0
#include "sim/base/text/json_depth.h"

#include <algorithm>

#include "sim/base/errors.h"

namespace earshot {

std::size_t json_depth(std::string_view text) {
  std::size_t depth = 0, deepest = 0;
  bool quoted = false;
  for (std::size_t i = 0; i < text.size(); ++i) {
    const char letter = text[i];
    if (quoted) {
      if (letter == '\\')
        ++i;  // whatever is escaped does not end the text
      else if (letter == '"')
        quoted = false;
    } else if (letter == '"') {
      quoted = true;
    } else if (letter == '[' || letter == '{') {
      deepest = std::max(deepest, ++depth);
    } else if ((letter == ']' || letter == '}') && depth > 0) {
      --depth;
    }
  }
  return deepest;
}

void check_json_depth(std::string_view text, const std::string& where) {
  if (json_depth(text) > kMaxJsonDepth)
    throw InputError(where, "has lists and maps nested hundreds of levels deep", "check that it is the right file");
}

}  // namespace earshot
