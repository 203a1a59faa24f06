// SPDX-License-Identifier: Apache-2.0
#include "sim/base/text/json_depth.h"

#include <algorithm>
#include <string>

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

std::size_t nul_within_json(std::string_view text) {
  const std::size_t nul = text.find('\0');
  return nul == text.npos || text.find_first_not_of('\0', nul) == text.npos ? text.npos : nul;
}

void check_no_nul(std::string_view text, const std::string& where) {
  if (const std::size_t nul = nul_within_json(text); nul != text.npos)
    throw InputError(where, "is not valid JSON: byte " + std::to_string(nul + 1) + " is NUL and text follows",
                     "check that it is the right file");
}

}  // namespace earshot
