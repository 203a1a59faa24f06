// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstddef>
#include <string>

#include "envs/episodes/episode_set.h"
#include "sim/acoustics/core/acoustic_config.h"

namespace earshot {

/// Whether environments over a set of episodes take the late sound of a source from its field (acoustics.field) or trace rays at each
/// pose: by the smaller work over all steps.  Work is counted in listener rays, so it does not depend on the scenes or the machine.
struct FieldChoice {
  bool on = false;
  std::string unfit;                       ///< why no field can be; empty: one can
  std::size_t scenes = 0, goals = 0;       ///< of the set; goals: distinct places of the source
  double places_per_goal = 0;              ///< at which a response is worked out, over all steps
  double photons = 0;                      ///< expected, per field
  double field_rays = 0, traced_rays = 0;  ///< per goal: work of the pass and of its gathers, and of what would be traced instead
  [[nodiscard]] std::string text() const;  ///< one line with the numbers
};

/// acoustics.field is `automatic` or on.  steps: of all agents and workers together; 0: each episode once, as many steps as its oracle
/// needs and at least kStepsPerEpisode.  A function of its arguments alone: workers and resumed runs come to the same.
/// Photons: (1.8 / field_error)^2, as furnished houses need (docs/explanation/estimators.md, section 10); a photon costs as much as 2.5
/// rays, which is measured (docs/evidence/hearing_cost.md), and a gather as much as 2.5; two of five steps of a policy lead to a new place.
/// A field has to halve the work, as the effect plan asks too.
FieldChoice choose_field(const AcousticConfig& acoustics, const EpisodeSet& set, double steps);

}  // namespace earshot
