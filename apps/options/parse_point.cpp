// SPDX-License-Identifier: Apache-2.0
#include "apps/options/parse_point.h"

#include <locale>
#include <sstream>

#include "sim/base/coordinates.h"
#include "sim/base/errors.h"

namespace earshot {

glm::dvec3 parse_point(const std::string& text, const std::string& option) {
  std::istringstream stream(text);
  stream.imbue(std::locale::classic());
  glm::dvec3 point{0};
  char comma1 = 0, comma2 = 0;
  stream >> point.x >> comma1 >> point.y >> comma2 >> point.z;
  const bool whole = !stream.fail() && comma1 == ',' && comma2 == ',' && (stream >> std::ws).eof();
  if (!whole || !is_valid_position(point))
    throw InputError(option + " " + text, "is not a point", "write three numbers in metres, for example 1.2,1.5,0.8");
  return point;
}

}  // namespace earshot
