// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <string>
#include <string_view>

#include "sim/scene/point_cloud/point_file.h"

namespace earshot {

/// Reads a PCD file (Point Cloud Library, versions .5 to .7) with the fields x, y and z: DATA ascii, binary (little-endian) or
/// binary_compressed (LZF, field by field).  The pose of the scanner (VIEWPOINT) moves nothing.  Throws InputError naming `where`.
PointCloud parse_pcd(std::string_view bytes, const std::string& where);

}  // namespace earshot
