#pragma once

#include <cstdint>
#include <optional>
#include <span>
#include <string_view>

#include "envs/batched_env.h"

namespace earshot {

/// Agents without learning.  random: uniform over the four actions.  greedy: turns to the louder ear, walks where the depth image shows
/// free space, stops when the sound is loud; uses only the observations of a policy.  oracle: follows the geodesic.
enum class Baseline { random, greedy, oracle };
std::optional<Baseline> baseline_by_name(std::string_view name);

/// Writes one action per agent, by row.  Stateless across calls but for the env's own counters: random numbers are keyed by (seed, env,
/// episode, step).
void baseline_actions(Baseline baseline, const BatchedEnv& env, std::uint64_t seed, int first_env, std::span<std::int32_t> actions);

}  // namespace earshot
