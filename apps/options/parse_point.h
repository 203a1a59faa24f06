// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <glm/vec3.hpp>
#include <string>

namespace earshot {

/// "X,Y,Z" as metres, at most kMaxCoordinateM from zero (sim/base/coordinates.h), with a decimal point whatever the locale.  Throws
/// InputError naming the option.
glm::dvec3 parse_point(const std::string& text, const std::string& option);

}  // namespace earshot
