// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstddef>
#include <cstdint>
#include <string>
#include <string_view>

#include "sim/base/text/yaml_node.h"

namespace earshot {

inline constexpr int kMaxYamlLevels = 64;
inline constexpr std::size_t kMaxYamlKeyBytes = 1000;
inline constexpr std::size_t kMaxYamlCopiedBytes = std::size_t{16} << 20;

/// Name of a YAML text in messages.
struct YamlSource {
  std::string where;
  bool has_lines = true;  ///< a file; of a value from the command line no line is named

  /// Throws InputError "where:line: problem; remedy".  line: from 1.
  [[noreturn]] void fail(std::size_t line, std::string_view problem, std::string_view remedy) const;
};

/// Reads the one document of a text by libyaml, the part of YAML that means one thing: maps with text keys, each given once, lists, scalars
/// with and without quotes, block texts, comments, anchors and aliases.  An alias is a copy.  Merge keys (`<<`) are kept as they are:
/// merge_maps.  A text without a value gives a null scalar.  Throws InputError "where:line: problem; remedy" for all else, among it: not
/// UTF-8, a control character, a tab that separates, a second document, a directive, a tag, a key twice, a key that is a list or map, more
/// than kMaxYamlLevels levels, aliases that copy more than kMaxYamlCopiedBytes.  Time and memory are linear in the text and its copies.
YamlNode parse_yaml(std::string_view text, const YamlSource& source);

}  // namespace earshot
