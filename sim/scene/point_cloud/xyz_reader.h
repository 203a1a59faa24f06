// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <string>
#include <string_view>

#include "sim/scene/point_cloud/point_file.h"

namespace earshot {

/// Reads points as text, one a line: x, y, z first, further columns are ignored.  Columns stand apart by blanks, semicolons or commas;
/// lines that begin with # or // are comments.  The first line may name the columns, x, y and z among them in any order; a line of one
/// whole number is the count of the points that follow (PTS), which must be right.  Throws InputError naming `where` and the line.
PointCloud parse_xyz(std::string_view bytes, const std::string& where);

}  // namespace earshot
