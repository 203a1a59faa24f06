// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <optional>
#include <string>

#include "sim/scene/scene.h"
#include "sim/scene/scene_report.h"

namespace earshot {

/// What the mesh itself says of the unit and the up axis of its file.
struct AxesGuess {
  std::optional<double> unit_m;  ///< another one than it was read with; nullopt: nothing speaks against that
  std::string unit_why;          ///< in both cases, one phrase
  std::optional<char> up;        ///< y or z, another one than it was read with; nullopt as above
  std::string up_why;
};

/// Of a scene from a mesh file; report: of this scene.
///
/// Unit: in a closed scene the mean free path 4 V / S, which is 1 to 20 m from furnished rooms to cathedrals; in an open one the height.
/// Beyond 40 m, or 150 m of height, the unit among millimetres, centimetres, inches and feet that brings it nearest to that of a room.
/// Up axis: the axis across which surfaces lie that are called floor, ceiling and the like; without such names a scene that stands upright
/// like a slab, more than twice as high and as long as it is deep, with a depth from 1.8 to 6 m.
AxesGuess guess_axes(const Scene& scene, const SceneReport& report);

}  // namespace earshot
