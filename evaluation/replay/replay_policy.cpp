// SPDX-License-Identifier: Apache-2.0
#include "evaluation/replay/replay_policy.h"

#include <memory>

#include "policy/torch_threads.h"
#include "trainer/checkpoint/checkpoint.h"
#include "trainer/rollout/actor.h"

namespace earshot {

PolicyObserver observe_with_policy(const std::filesystem::path& path, const RunConfig& config) {
  use_one_torch_thread();
  const Checkpoint checkpoint = load_checkpoint(path);
  const PolicyNetwork policy = network_of(checkpoint, config.env.observation, config.policy, path.string());
  const auto actor = std::make_shared<Actor>(policy, 0, 1);
  return {.judge =
              [actor](const BatchedEnv& env) {
                const PolicyOutput& output = actor->observe(env);
                PolicyJudgement judgement{.value = output.value[0].item<double>()};
                const torch::Tensor probabilities = output.logits[0].softmax(0);
                for (int i = 0; i < kNumActions; ++i)
                  judgement.probabilities[static_cast<std::size_t>(i)] = probabilities[i].item<double>();
                return judgement;
              },
          .after_step = [actor](const BatchedEnv& env) { actor->advance(env); }};
}

}  // namespace earshot
