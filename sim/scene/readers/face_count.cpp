// SPDX-License-Identifier: Apache-2.0
#include "sim/scene/readers/face_count.h"

#include <algorithm>
#include <vector>

#include "sim/base/text/text_match.h"
#include "sim/scene/readers/stl_reader.h"
#include "sim/scene/readers/text_scanner.h"

namespace earshot {

std::uint64_t count_obj_faces(std::string_view bytes) {
  std::uint64_t count = 0;
  for (LineScanner lines(bytes); lines.next();) {
    std::string_view rest = lines.line();
    const std::string_view word = take_word(rest);
    count += word == "f" || word == "fo" ? 1 : 0;
  }
  return count;
}

std::uint64_t count_ply_faces(std::string_view bytes) {
  std::uint64_t count = 0;
  std::vector<std::string_view> words;
  for (LineScanner lines(bytes); lines.next();) {
    split_words(lines.line(), words);
    if (words.size() == 1 && words[0] == "end_header") break;
    if (words.size() != 3 || words[0] != "element" || !(words[1] == "face" || words[1] == "tristrips")) continue;
    count += static_cast<std::uint64_t>(std::max<std::int64_t>(parse_whole(words[2]).value_or(0), 0));
  }
  return count;
}

std::uint64_t count_stl_faces(std::string_view bytes) {
  if (const auto count = binary_stl_count(bytes)) return *count;
  std::uint64_t count = 0;
  std::vector<std::string_view> words;
  for (LineScanner lines(bytes); lines.next();) {
    split_words(lines.line(), words);
    for (const std::string_view word : words) {
      const std::string folded = fold_case(word);
      if (folded == "solid" || folded == "endsolid") break;  // a name follows
      count += folded == "facet" ? 1 : 0;
    }
  }
  return count;
}

}  // namespace earshot
