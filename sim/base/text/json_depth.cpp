// SPDX-License-Identifier: Apache-2.0
#include "sim/base/text/json_depth.h"

#include <algorithm>
#include <cstdint>
#include <map>
#include <vector>

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

void check_unique_keys(std::string_view text, const std::string& where) {
  struct Level {
    std::string name = {};                           // the key under which this object or list lies
    std::map<std::string, std::uint32_t> keys = {};  // with their lines
    std::string last = {};                           // key whose value comes next
  };
  std::vector<Level> levels;
  std::string word;
  std::uint32_t line = 1, word_line = 1;
  for (std::size_t i = 0; i < text.size(); ++i) {
    const char letter = text[i];
    if (letter == '\n') ++line;
    if (letter == '"') {
      word_line = line;
      const std::size_t begin = ++i;
      while (text[i] != '"') i += text[i] == '\\' ? 2 : 1;
      word = text.substr(begin, i - begin);
    } else if (letter == '[' || letter == '{') {
      levels.push_back({.name = levels.empty() ? "" : levels.back().last});
    } else if (letter == ']' || letter == '}') {
      levels.pop_back();
    } else if (letter == ':') {
      const auto [first, is_new] = levels.back().keys.emplace(word, word_line);
      levels.back().last = word;
      if (is_new) continue;
      std::string path;
      for (const Level& level : levels)
        if (!level.name.empty()) path += level.name + ".";
      throw InputError(where + ":" + std::to_string(word_line),
                       path + word + " is given twice, in lines " + std::to_string(first->second) + " and " + std::to_string(word_line),
                       "keep one of the two");
    }
  }
}

}  // namespace earshot
