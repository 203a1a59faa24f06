// SPDX-License-Identifier: Apache-2.0
#include "sim/base/text/json_keys.h"

#include <cstdint>
#include <map>
#include <vector>

#include "sim/base/errors.h"

namespace earshot {

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
