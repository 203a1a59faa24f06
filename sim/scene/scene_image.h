// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <string>
#include <string_view>

#include "sim/scene/scene.h"

namespace earshot {

/// A scene as bytes, for a file that the next process reads in place of loading and repairing it: mesh, flat patches, materials, air and
/// report.  Native order; the caller keeps the version and the identity of what the scene was loaded from.
std::string encode_scene(const Scene& scene);

/// The same scene: rays, hash and report are the same bits.  Only the ray structure is built anew, from the patches.  Indices and numbers
/// are checked: an invalid image throws InputError naming `where`.  About 0.1 us per triangle and 0.2 us per patched triangle.
Scene decode_scene(std::string_view bytes, const std::string& where);

}  // namespace earshot
