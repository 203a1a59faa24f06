// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <filesystem>
#include <string>

#include "trainer/checkpoint/checkpoint.h"
#include "trainer/run/run_config.h"

namespace earshot {

/// How weights are stored.  float16 halves the file; each weight then differs by at most 2^-11 of itself, and the agent is another one by
/// that little.
enum class WeightStorage { float32, float16 };

/// The parts of a checkpoint that acting and fine-tuning need: weights, configuration and origin, without the state of the training.
/// Throws InputError naming the weights that float16 (largest number 65,504) cannot hold.
Checkpoint policy_of(const Checkpoint& checkpoint, WeightStorage storage);

/// A policy that another trainer wrote as a TorchScript file (module_policy.h).  It sees the sensors of `config`, and acts as config.name
/// and config.eval_actions say; keys of policy and guidance have no part in it.  Throws InputError as make_policy().
Checkpoint policy_of_module(RunConfig config, const std::string& file);

/// A few lines for people: name, architecture, parameters, steps of training, seed, engine.  `where`: the file.
std::string describe_policy(const Checkpoint& checkpoint, const std::string& where);
/// The same as JSON with a schema_version (docs/reference/json_output.md).
std::string policy_json(const Checkpoint& checkpoint, const std::string& where);

}  // namespace earshot
