// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <string>
#include <string_view>

#include "sim/base/text/yaml_cursor.h"

// The text of YAML's scalars.  Each reader begins at the first byte of a scalar and leaves the cursor behind it.

namespace earshot {

/// Place of a scalar.
struct YamlPlace {
  int parent = -1;       ///< column of the map or list that holds it; its lines are indented further
  bool in_flow = false;  ///< within [ ] or { }
  bool is_key = false;   ///< of one line
};

/// Throws InputError unless a scalar without quotes can begin here.
void check_plain_start(const YamlCursor& cursor, bool in_flow);
/// Without quotes; lines that follow with more indentation are joined to it.
std::string read_plain(YamlCursor& cursor, const YamlPlace& place);
/// In single or double quotes.
std::string read_quoted(YamlCursor& cursor, const YamlPlace& place);
/// Lines behind `|` or `>`.
std::string read_block_text(YamlCursor& cursor, int parent);

/// Whether texts may hold the character: no control characters but tab and line ends, no separators of lines and paragraphs, no byte-order
/// mark, no character that is none.
bool is_text_character(char32_t character);

}  // namespace earshot
