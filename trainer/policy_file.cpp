#include "trainer/policy_file.h"

#include <fmt/format.h>

#include <cmath>

#include "sim/base/errors.h"
#include "trainer/effective_config.h"

namespace earshot {

Checkpoint policy_of(const Checkpoint& checkpoint, WeightStorage storage) {
  Checkpoint policy;
  static_cast<CheckpointMetadata&>(policy) = checkpoint;
  policy.is_policy = true;
  policy.weights = checkpoint.weights;
  if (storage == WeightStorage::float32) return policy;
  for (auto& [name, tensor] : policy.weights) {
    tensor = tensor.to(torch::kFloat16);
    if (!torch::isfinite(tensor).all().item<bool>())
      throw InputError("weights '" + name + "'", "have values that float16 cannot hold", "store them as float32");
  }
  return policy;
}

std::string describe_policy(const Checkpoint& checkpoint, const std::string& where) {
  std::int64_t num_parameters = 0;
  for (const auto& [name, tensor] : checkpoint.weights) num_parameters += tensor.numel();
  const RunConfig config = parse_effective_config(checkpoint.config_yaml, where + " (its config)", {});
  std::string text = fmt::format("{}: {}\n", where, checkpoint.is_policy ? "policy" : "checkpoint of a training");
  text += fmt::format("  name          {}\n  architecture  {}\n  parameters    {}\n", config.name, checkpoint.architecture, num_parameters);
  text += fmt::format("  trained       {} steps, {} updates, {:.1f} min, seed {}, {} worker{}\n", checkpoint.env_steps, checkpoint.update,
                      checkpoint.elapsed_s / 60, checkpoint.seed, checkpoint.world_size, checkpoint.world_size == 1 ? "" : "s");
  if (std::isfinite(checkpoint.mean_reward))
    text += fmt::format("  mean reward   {:.2f} per episode of training\n", checkpoint.mean_reward);
  return text + fmt::format("  engine        {} (commit {})\n", checkpoint.engine, checkpoint.engine_commit);
}

}  // namespace earshot
