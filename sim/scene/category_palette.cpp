// SPDX-License-Identifier: Apache-2.0
#include "sim/scene/category_palette.h"

#include <cmath>
#include <glm/vec3.hpp>
#include <string>

#include "sim/scene/appearance.h"
#include "sim/scene/surface_palette.h"

namespace earshot {

std::vector<std::uint8_t> category_palette() {
  std::vector<std::uint8_t> palette;
  for (const std::string& name : category_names()) {
    const glm::vec3 color = name == "unknown" ? glm::vec3(0) : palette_color("category " + name, "");
    for (int channel = 0; channel < 3; ++channel) palette.push_back(static_cast<std::uint8_t>(std::lround(255.f * color[channel])));
  }
  return palette;
}

}  // namespace earshot
