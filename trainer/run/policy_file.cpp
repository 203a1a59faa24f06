// SPDX-License-Identifier: Apache-2.0
#include "trainer/run/policy_file.h"

#include <fmt/format.h>

#include <cmath>
#include <limits>
#include <nlohmann/json.hpp>

#include "sim/base/engine_commit.h"
#include "sim/base/engine_hash.h"
#include "sim/base/errors.h"
#include "sim/base/text/json.h"
#include "trainer/run/effective_config.h"

namespace earshot {

Checkpoint policy_of(const Checkpoint& checkpoint, WeightStorage storage) {
  Checkpoint policy;
  static_cast<CheckpointMetadata&>(policy) = checkpoint;
  policy.is_policy = true;
  policy.weights = checkpoint.weights;
  policy.module = checkpoint.module;
  if (storage == WeightStorage::float32) return policy;
  for (auto& [name, tensor] : policy.weights) {
    if (tensor.scalar_type() != torch::kFloat32) continue;  // a buffer of a module
    tensor = tensor.to(torch::kFloat16);
    if (!torch::isfinite(tensor).all().item<bool>())
      throw InputError("weights '" + name + "'", "have values outside the range of float16", "leave out --float16");
  }
  return policy;
}

Checkpoint policy_of_module(RunConfig config, const std::string& file) {
  config.policy = {.seed = config.policy.seed, .module = file};
  config.guidance = {};
  const PolicyNetwork network = make_policy(config.env.observation, config.policy);
  Checkpoint policy;
  policy.is_policy = true;
  policy.config_yaml = config_text(config);
  policy.architecture = network->architecture();
  policy.weights = weights_of(network);
  policy.module = network->module_file();
  policy.seed = config.seed;
  policy.mean_reward = std::numeric_limits<double>::quiet_NaN();
  policy.engine = engine_hash();
  policy.engine_commit = engine_commit();
  return policy;
}

namespace {

std::int64_t num_parameters_of(const Checkpoint& checkpoint) {
  std::int64_t sum = 0;
  for (const auto& [name, tensor] : checkpoint.weights) sum += tensor.numel();
  return sum;
}

}  // namespace

std::string policy_json(const Checkpoint& checkpoint, const std::string& where) {
  const RunConfig config = parse_effective_config(checkpoint.config_yaml, where + " (its config)", {});
  const bool has_reward = std::isfinite(checkpoint.mean_reward);
  const nlohmann::ordered_json json{{"schema_version", 1},
                                    {"file", where},
                                    {"is_policy", checkpoint.is_policy},
                                    {"name", config.name},
                                    {"architecture", checkpoint.architecture},
                                    {"parameters", num_parameters_of(checkpoint)},
                                    {"env_steps", checkpoint.env_steps},
                                    {"updates", checkpoint.update},
                                    {"elapsed_s", checkpoint.elapsed_s},
                                    {"seed", checkpoint.seed},
                                    {"workers", checkpoint.world_size},
                                    {"mean_reward", has_reward ? nlohmann::ordered_json(checkpoint.mean_reward) : nlohmann::ordered_json()},
                                    {"engine", checkpoint.engine},
                                    {"engine_commit", checkpoint.engine_commit}};
  return json_text(json, 2) + "\n";
}

std::string describe_policy(const Checkpoint& checkpoint, const std::string& where) {
  const std::int64_t num_parameters = num_parameters_of(checkpoint);
  const RunConfig config = parse_effective_config(checkpoint.config_yaml, where + " (its config)", {});
  std::string text = fmt::format("{}: {}\n", where, checkpoint.is_policy ? "policy" : "training checkpoint");
  text += fmt::format("  name          {}\n  architecture  {}\n  parameters    {}\n", config.name, checkpoint.architecture, num_parameters);
  text += fmt::format("  trained       {} steps, {} updates, {:.1f} min, seed {}, {} worker{}\n", checkpoint.env_steps, checkpoint.update,
                      checkpoint.elapsed_s / 60, checkpoint.seed, checkpoint.world_size, checkpoint.world_size == 1 ? "" : "s");
  if (std::isfinite(checkpoint.mean_reward)) text += fmt::format("  mean reward   {:.2f} per training episode\n", checkpoint.mean_reward);
  if (checkpoint.held_out && checkpoint.held_out->best_update == checkpoint.update && checkpoint.update > 0) {
    const HeldOutScore& best = checkpoint.held_out->best;
    text += fmt::format("  held out      success {:.3f} [{:.3f}, {:.3f}], SPL {:.3f}: the best of {} evaluations so far\n",
                        best.success.mean, best.success.low, best.success.high, best.spl.mean, checkpoint.held_out->evaluations);
  }
  return text + fmt::format("  engine        {} (commit {})\n", checkpoint.engine, checkpoint.engine_commit);
}

}  // namespace earshot
