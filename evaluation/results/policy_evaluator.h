// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <string>

#include "evaluation/results/evaluator.h"
#include "policy/policy_network.h"

namespace earshot {

/// Lets a policy act in every episode of the set, or in those of evaluation.part.  evaluation.actions and evaluation.env are not read.  The
/// result lacks the hash of the policy and what libtorch adds to the toolchain.  Throws as run_episodes.
EvaluationResult evaluate_policy(const PolicyNetwork& policy, const EnvConfig& env, ActionChoice actions,
                                 const EvaluationConfig& evaluation, const std::string& name);

}  // namespace earshot
