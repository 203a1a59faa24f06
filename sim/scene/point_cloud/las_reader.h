// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <string>
#include <string_view>

#include "sim/scene/point_cloud/point_file.h"

namespace earshot {

/// Reads a LAS file (ASPRS LAS 1.0 to 1.4, point formats 0 to 10, without compression): coordinates times scale plus offset.  Points that
/// are withheld or classified as noise (7 and 18) are left out and counted.  Throws InputError naming `where`.
PointCloud parse_las(std::string_view bytes, const std::string& where);

}  // namespace earshot
