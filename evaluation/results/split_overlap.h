// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <optional>
#include <span>
#include <string>
#include <vector>

#include "sim/scene/mesh/triangle_mesh.h"

namespace earshot {

/// Something of a test set that the training has too.
struct SplitOverlap {
  std::string tested, trained;
  std::string why;  ///< relation of the two: "the same as"
};

/// Fraction of the corners of the mesh that has fewer which the other has as well, to about 5 cm: both moved so that their bounds begin at
/// the origin, distinct cells of 5 cm counted.  1: one is a copy of the other, moved or with other triangles between the same corners, or
/// a part of it from the same corner on.  Not found: copies that are turned or scaled.
double geometry_overlap(const TriangleMesh& a, const TriangleMesh& b);
/// From here on two scenes count as near-duplicates.  Different generated houses have 0.1 and less in common.
inline constexpr double kNearDuplicate = 0.5;

/// Those of `tested` that `trained` names too: generated ones by their kind and seed, whatever their other settings.
std::vector<std::string> shared_scenes(std::span<const std::string> trained, std::span<const std::string> tested);
/// trained, tested: SCENEs without ranges.  Names first, then geometry.  Throws InputError if a scene cannot be loaded.
std::optional<SplitOverlap> find_scene_overlap(std::span<const std::string> trained, std::span<const std::string> tested,
                                               const std::string& scene_root);
/// trained, tested: sounds without ranges or folders.  Names first, then samples up to their level.  Throws InputError if a sound cannot be
/// opened.
std::optional<SplitOverlap> find_sound_overlap(std::span<const std::string> trained, std::span<const std::string> tested,
                                               const std::string& sound_root);

}  // namespace earshot
