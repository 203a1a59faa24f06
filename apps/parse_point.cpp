#include <cmath>
#include <sstream>

#include "apps/commands.h"
#include "sim/base/errors.h"

namespace earshot {

glm::vec3 parse_point(const std::string& text, const std::string& option) {
  std::istringstream stream(text);
  glm::vec3 point{0};
  char comma1 = 0, comma2 = 0;
  stream >> point.x >> comma1 >> point.y >> comma2 >> point.z;
  const bool whole = !stream.fail() && comma1 == ',' && comma2 == ',' && (stream >> std::ws).eof();
  if (!whole || !std::isfinite(point.x) || !std::isfinite(point.y) || !std::isfinite(point.z))
    throw InputError(option + " " + text, "is not a point", "write three numbers in metres, for example 1.2,1.5,0.8");
  return point;
}

}  // namespace earshot
