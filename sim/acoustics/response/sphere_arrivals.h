// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <glm/vec3.hpp>
#include <vector>

#include "sim/acoustics/core/arrival.h"
#include "sim/acoustics/model/acoustic_scene.h"
#include "sim/acoustics/paths/early_reflections.h"
#include "sim/acoustics/paths/pose_effects.h"

namespace earshot {

/// Direct sound of a source with a radius, and its sound round edges and straight through walls: each part of the sphere brings its own.
///
/// From the listener the sphere is an even disc of its radius, square to the line to its centre.  config.direct_rays points of equal parts
/// of that disc (pairs of opposite points on a spiral, turned by the seed), each moved along its ray to the distance of the centre, stand
/// for it.  A point has its line of sight, its waves at edges and its walls, as a point source has them, and its energy is an equal part
/// of the whole.  Energies of different points add: parts of a surface are not in phase.  So nothing counts twice at a shadow boundary:
/// the field of each point, sum of direct sound and edge waves, is the uniform theory's, and the sphere has the mean of their energies.
///
/// Without diffraction and transmission the energy is the visible fraction of the disc: behind a straight edge that of a circular segment,
/// within 0.05 for 64 points, in the mean over edges within 0.012; the error falls as the number to the power of -3/4.  A sphere in full
/// sight, away from edges, has the arrival of its centre.
///
/// One arrival for each path (Arrival::identity): its direction and departure are means over the points by energy, so that sound comes
/// from the visible part.  Sound that goes round edges from hidden points while others are in sight belongs to the direct sound where its
/// detour is below half a wave (boundary_weight): two arrivals at one time would add as pressures.
///
/// Not modelled: images and waves of panels are those of the centre; edges are those of the sequences that were found from the centre; what
/// lies behind a surface that cuts the sphere counts as hidden.

/// Is the source looked at as a sphere from there, and does any of the three matter in this scene?  Otherwise its centre stands for it.
bool is_sphere(const AcousticScene& scene, const SoundSource& source, glm::vec3 listener);

/// Adds these arrivals, without the source's emission, to `arrivals`, which has the image paths of the centre, sorted by distance, and
/// stays so.  The same bits for the same arguments and seed.  Returns the effects of the pose: in_sight if any point is, transmission if
/// any is hidden and walls let sound through, diffraction if a path over edges matters.  Allocates.  Cost: as many shadow
/// rays as points, and as many searches over edges (diffraction_budget.h), a quarter of them if no point is in sight and there are 32 or
/// more.
PoseEffects find_sphere_arrivals(const AcousticScene& scene, const EarlyCandidates& candidates, glm::vec3 listener,
                                 std::vector<Arrival>& arrivals);

}  // namespace earshot
