// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <string>
#include <string_view>

#include "sim/scene/annotations/annotations.h"

namespace earshot {

/// Reads HM3D's `SCENE.semantic.txt`: the line `HM3D Semantic Annotations`, then one instance a line, `id,RRGGBB,"category",region`.
/// Source: the data set's own files.  Throws InputError naming `where` and the line.
Annotations parse_semantic_text(std::string_view text, const std::string& where);

}  // namespace earshot
