// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <optional>
#include <span>
#include <string>

#include "envs/sensors/sensor.h"
#include "policy/policy_network.h"

namespace earshot {

/// Largest relative difference between a sequence and its steps, and between rows alone and in a batch: sums in another order.
inline constexpr double kMaxTrialError = 1e-4;

/// Runs a network on drawn observations and says what PPO could not learn from: outputs that differ from call to call, that are not finite,
/// that depend on the other rows, a sequence that is not its steps, logits or values without a gradient; nullopt: nothing.  Throws what
/// the network throws.
/// has_sequence: whether a sequence is computed otherwise than step by step.
std::optional<std::string> fault_of_network(PolicyNetworkImpl& network, std::span<const SensorSpec> sensors, bool has_sequence);

}  // namespace earshot
