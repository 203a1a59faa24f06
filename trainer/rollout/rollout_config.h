// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>

#include "envs/sensors/observation.h"
#include "trainer/learner/guidance_config.h"

namespace earshot {

/// Settings of a rollout collector: part of a run config (rollout_config(RunConfig)), which has validated it.
struct RolloutConfig {
  std::uint64_t seed = 0;  ///< of sampled actions and of the episodes in which the oracle acts
  int rollout_steps = 150;
  bool overlap = false;     ///< steps the environments in two halves, one while the policy looks at the other
  ObservationSpec sensors;  ///< of the batch, those that only the losses read included
  GuidanceConfig guidance;
};

}  // namespace earshot
