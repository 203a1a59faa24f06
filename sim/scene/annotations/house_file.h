// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <string>
#include <string_view>

#include "sim/scene/annotations/annotations.h"

namespace earshot {

/// Reads a Matterport3D `.house`: one record a line, its kind a letter, fields between blanks, `#` for a blank within a name.  The id of an
/// instance is the index of its record O, its category the mpcat40 name of the record C that it points to; -1: none.  Records of other
/// kinds are skipped, but for H, whose counts of objects and categories must be met.
/// Source: the data set's description of its house files.  Throws InputError naming `where` and the line.
Annotations parse_house_file(std::string_view text, const std::string& where);

}  // namespace earshot
