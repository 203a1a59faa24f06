// SPDX-License-Identifier: Apache-2.0
#include "trainer/run/initial_policy.h"

#include "trainer/checkpoint/checkpoint.h"
#include "trainer/checkpoint/find_checkpoint.h"

namespace earshot {

void load_initial_policy(const RunConfig& config, const PolicyNetwork& policy) {
  const std::filesystem::path file = find_checkpoint(config.initial_policy);
  load_weights(policy, load_checkpoint(file), file.string());
}

void check_policy(const RunConfig& config, const std::filesystem::path& resume) {
  const PolicyNetwork policy = make_policy(config.env.observation, config.policy);
  if (!resume.empty())
    load_weights(policy, load_checkpoint(resume), resume.string());
  else if (!config.initial_policy.empty())
    load_initial_policy(config, policy);
}

}  // namespace earshot
