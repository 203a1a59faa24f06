// SPDX-License-Identifier: Apache-2.0
#include "trainer/rollout/actor.h"

#include <gtest/gtest.h>

#include "policy/actor_critic.h"
#include "tests/support/envs/env_fixture.h"
#include "trainer/run/run_config.h"

namespace earshot {
namespace {

constexpr int kRows = 2;

EnvConfig env_config(int max_steps) {
  EnvConfig config = quick_env_config();
  config.task.max_steps = max_steps;
  config.observation.camera.width_px = config.observation.camera.height_px = 48;
  return config;
}

/// Envs of one length of episodes, and the policy that acts in them.
class Acting {
 public:
  Acting(int max_steps, const ActorCritic& policy)
      : config_(env_config(max_steps)), env_(config_, quick_set(2), make_scene_cache(config_), kRows), actor_(policy, 0, kRows) {
    env_.reset();
  }
  /// Turns and walks, as both do.
  void step(int number) {
    actor_.observe(env_);
    env_.step(std::vector<std::int32_t>{1 + number % 3, 1 + (number + 1) % 3});
  }
  BatchedEnv& env() { return env_; }
  Actor& actor() { return actor_; }

 private:
  EnvConfig config_;
  BatchedEnv env_;
  Actor actor_;
};

// A time limit cuts an episode off, it does not end it: what is bootstrapped with is what the policy, with its memory of the episode,
// thinks of the last observation.  The same episode under a longer limit goes on there, and says so.
TEST(Actor, TheValueAtATimeLimitIsThatOfTheEpisodeThatGoesOn) {
  torch::set_num_threads(1);
  torch::manual_seed(3);
  PolicyConfig policy_config;
  policy_config.hidden_size = policy_config.visual_features = policy_config.audio_features = 16;
  policy_config.conv_channels = 4;
  const ActorCritic policy(env_config(5).observation, policy_config);
  Acting cut(5, policy), goes_on(50, policy);
  for (int i = 0; i < 5; ++i) {
    if (i > 0) {
      EXPECT_TRUE(cut.actor().truncated_values(cut.env()).equal(torch::zeros({kRows}))) << i;
      cut.actor().advance(cut.env());
      goes_on.actor().advance(goes_on.env());
    }
    cut.step(i);
    goes_on.step(i);
  }
  ASSERT_TRUE(cut.env().truncated()[0] && cut.env().truncated()[1]);
  ASSERT_TRUE(goes_on.env().active()[0] && goes_on.env().active()[1]);
  for (int row = 0; row < kRows; ++row) ASSERT_FALSE(goes_on.env().truncated()[row] || goes_on.env().terminated()[row]);
  const torch::Tensor at_the_limit = cut.actor().truncated_values(cut.env());
  const torch::Tensor hidden = goes_on.actor().hidden().clone();
  goes_on.actor().advance(goes_on.env());
  EXPECT_GT((goes_on.actor().hidden() - hidden).abs().max().item<float>(), 1e-3f) << "the policy remembers";
  EXPECT_TRUE(at_the_limit.allclose(goes_on.actor().peek_value(goes_on.env()), 0, 1e-6)) << at_the_limit;
  // Without its memory it thinks otherwise: the test could tell.
  goes_on.actor().restore(torch::zeros_like(hidden), torch::ones({kRows}));
  EXPECT_GT((at_the_limit - goes_on.actor().peek_value(goes_on.env())).abs().max().item<float>(), 1e-4f);
}

}  // namespace
}  // namespace earshot
