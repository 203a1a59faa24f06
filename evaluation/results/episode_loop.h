// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <functional>
#include <span>
#include <string>

#include "envs/batch/batched_env.h"
#include "evaluation/results/evaluator.h"

namespace earshot {

/// The loop that all agents share: act until every episode of the set has ended once.  The result lacks the hash of the policy and what
/// libtorch adds to the toolchain.
/// name: of the agent.  act: writes an action per row for the current observations.  after: called behind each step.  Throws as
/// load_evaluated_set, and RunError where stages of the last episodes do not return for ten minutes.
EvaluationResult run_episodes(const EnvConfig& env, const EvaluationConfig& evaluation, const std::string& name,
                              const std::function<void(BatchedEnv&, std::span<std::int32_t>)>& act,
                              const std::function<void(const BatchedEnv&)>& after);

}  // namespace earshot
