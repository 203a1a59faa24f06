// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <optional>
#include <string>

#include "policy/policy_network.h"
#include "trainer/run/run_config.h"

namespace earshot {

/// Parameters of a trained network stay below a hundred; beyond this much nothing is left of what they had learned.
inline constexpr double kMaxOfAWeight = 1e3;

/// Fault of the weights: one that is not finite, or larger than kMaxOfAWeight; nullopt: no fault.  The same on all workers, as
/// their weights are.
std::optional<std::string> fault_of_weights(const PolicyNetwork& policy);

/// The key of `ppo` or `guidance` that lies furthest from its default, by its factor, as the likeliest reason: "ppo.learning_rate = 1e+09
/// (default 0.00025)".  Where none is off by a factor of ten: the learning rate.
std::string suspect_key(const RunConfig& config);

}  // namespace earshot
