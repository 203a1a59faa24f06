// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <glm/vec3.hpp>
#include <string_view>

namespace earshot {

/// Encoded sRGB in [0, 1] of a surface whose file says nothing of colours, and of all generated scenes: by the words of the acoustic
/// material's name (wood_furniture, brick_painted), else a pale colour drawn from the whole name.  object: shifts the brightness by up to 8
/// %, so that two chairs of one material can be told apart.  A function of the two texts; O(their length).
glm::vec3 palette_color(std::string_view material, std::string_view object);

}  // namespace earshot
