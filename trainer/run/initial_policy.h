// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "policy/actor_critic.h"
#include "trainer/run/run_config.h"

namespace earshot {

/// The weights of config.initial_policy (a policy file, checkpoint or run folder), for a run that starts from them.  Throws InputError: no
/// such file, damaged, or of another architecture than `config` asks for; then nothing has changed.
void load_initial_policy(const RunConfig& config, ActorCritic& policy);
/// The same without a policy: before workers are started.
void check_initial_policy(const RunConfig& config);

}  // namespace earshot
