// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "policy/actor_critic.h"

namespace earshot {

/// The smallest observation that a policy takes.
inline ObservationSpec pointgoal_only() {
  ObservationSpec spec;
  spec.depth = spec.spectrogram = false;
  spec.pointgoal = true;
  return spec;
}

/// With the seed of all tests of the learner, so that they start from the same weights.
inline ActorCritic pointgoal_policy(int hidden_size) {
  PolicyConfig config;
  config.hidden_size = hidden_size;
  config.seed = 3;
  return ActorCritic(pointgoal_only(), config);
}

}  // namespace earshot
