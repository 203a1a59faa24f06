// SPDX-License-Identifier: Apache-2.0
// Does the whole chain of policy, rollout buffer and learner learn?  Two tasks with a known answer, each beside a broken variant that must
// fail.
#include <gtest/gtest.h>

#include <vector>

#include "policy/action_distribution.h"
#include "policy/actor_critic.h"
#include "sim/base/random.h"
#include "trainer/learner/ppo.h"

namespace earshot {
namespace {

constexpr int kEnvs = 32, kHidden = 32;
const std::unique_ptr<Collective> kSingle = make_single_worker();
Collective& kAlone = *kSingle;

/// A cue sounds in the first step of an episode (one of four patches of the spectrogram); the action of the fifth step earns 1 if it names
/// the cue.
class MemoryTask {
 public:
  static constexpr int kEpisodeSteps = 5, kPatch = 4, kSize = 17;

  static ObservationSpec spec() {
    ObservationSpec spec;
    spec.depth = false;
    spec.sound.fft_size = spec.sound.window = 128;  // 65 bins / 4 = 17 rows
    spec.sound.hop = 40;
    spec.sound.num_samples = 64 * 40;  // 65 frames / 4 = 17 columns
    return spec;
  }

  [[nodiscard]] ObservationTensors observe() const {
    torch::Tensor sound = torch::zeros({kEnvs, kSize, kSize, 2});
    if (step_ == 0)
      for (int env = 0; env < kEnvs; ++env) {
        const int first = kPatch * static_cast<int>(cue(env));
        sound[env].slice(0, first, first + kPatch + 1).fill_(1);
      }
    return {{"spectrogram", sound}};
  }
  /// Rewards of this step; true if it ended the episodes.
  bool step(const std::vector<std::int32_t>& actions, std::vector<float>& rewards) {
    const bool last = step_ == kEpisodeSteps - 1;
    for (int env = 0; env < kEnvs; ++env)
      rewards[static_cast<std::size_t>(env)] =
          last && actions[static_cast<std::size_t>(env)] == static_cast<std::int32_t>(cue(env)) ? 1.f : 0.f;
    step_ = last ? 0 : step_ + 1;
    episode_ += last;
    return last;
  }
  [[nodiscard]] std::uint32_t episode() const { return episode_; }
  [[nodiscard]] std::uint32_t step_index() const { return step_; }

 private:
  [[nodiscard]] std::uint32_t cue(int env) const {
    return RandomStream(77, Purpose::test, static_cast<std::uint32_t>(env), episode_).below(4, 0);
  }
  std::uint32_t episode_ = 0, step_ = 0;
};

/// Fraction of right answers over the last 20 rollouts.  forgetful: the hidden state is zeroed before every step, when acting and when
/// learning.
double accuracy_after_training(int updates, bool forgetful) {
  const ObservationSpec spec = MemoryTask::spec();
  PolicyConfig policy_config;
  policy_config.hidden_size = kHidden;
  policy_config.audio_features = 16;
  policy_config.conv_channels = 4;
  policy_config.seed = 1;
  PpoConfig config;
  config.learning_rate = 3e-3;
  config.max_gradient_norm = 0.5;
  config.entropy_coefficient = 0.01;
  config.epochs = 4;
  ActorCritic policy(spec, policy_config);
  PpoLearner learner(policy, config, 1);
  RolloutBuffer rollout(spec, 4 * MemoryTask::kEpisodeSteps, kEnvs, kHidden);

  MemoryTask task;
  torch::Tensor hidden = torch::zeros({kEnvs, kHidden});
  bool fresh = true;
  double right = 0, asked = 0;
  std::vector<std::int32_t> actions(kEnvs);
  std::vector<float> rewards(kEnvs);
  for (int update = 0; update < updates; ++update) {
    {
      const torch::NoGradGuard no_gradient;
      rollout.begin(hidden);
      for (int t = 0; t < 4 * MemoryTask::kEpisodeSteps; ++t) {
        const ObservationTensors seen = task.observe();
        const torch::Tensor not_done = torch::full({kEnvs}, fresh || forgetful ? 0.f : 1.f);
        const PolicyOutput output = policy->step(seen, hidden, not_done);
        std::vector<ActingEnv> acting_envs;
        for (std::uint32_t env = 0; env < kEnvs; ++env) acting_envs.push_back({env, task.episode(), task.step_index()});
        sample_actions(output.logits, acting_envs, 5, actions);
        const torch::Tensor taken = torch::tensor(std::vector<std::int64_t>(actions.begin(), actions.end()));
        rollout.push(seen, not_done, taken, log_probabilities(output.logits, taken), output.value);
        fresh = task.step(actions, rewards);
        const std::vector<std::uint8_t> ended(kEnvs, fresh), no(kEnvs, 0), yes(kEnvs, 1);
        rollout.push_outcome(rewards, ended, no, torch::zeros({kEnvs}), yes);
        hidden = output.hidden;
        if (fresh && update >= updates - 20) {
          for (const float reward : rewards) right += reward;
          asked += kEnvs;
        }
      }
      rollout.finish(policy->step(task.observe(), hidden, torch::full({kEnvs}, fresh || forgetful ? 0.f : 1.f)).value);
    }
    const UpdateStats stats = learner.update(rollout, 0, static_cast<std::uint64_t>(update), kAlone);
    EXPECT_LT(stats.max_ratio_error, 1e-4);
    EXPECT_EQ(stats.skipped_steps, 0);
  }
  return right / asked;
}

TEST(Learning, RemembersACueForFourSteps) {
  constexpr int updates = 120;
  const double with_memory = accuracy_after_training(updates, false), without = accuracy_after_training(updates, true);
  RecordProperty("with_memory", std::to_string(with_memory));
  RecordProperty("without", std::to_string(without));
  EXPECT_GT(with_memory, 0.9);
  // Chance is 1/4; 20 rollouts of 4 x 32 answers have a standard error of 0.009.
  EXPECT_NEAR(without, 0.25, 0.05);
}

/// Mean value that the critic learns where every step earns 1 and an episode is out of time after five steps, for ever.
double learned_value(bool truncation_bootstraps) {
  ObservationSpec spec;
  spec.depth = spec.spectrogram = false;
  spec.pointgoal = true;
  PolicyConfig policy_config;
  policy_config.hidden_size = 8;
  PpoConfig config;
  config.learning_rate = 3e-2;
  config.max_gradient_norm = 10;
  config.clip_value_loss = false;
  config.gae.gamma = 0.9;
  ActorCritic policy(spec, policy_config);
  PpoLearner learner(policy, config, 1);
  constexpr int steps = 20, episode_steps = 5, envs = 4;
  RolloutBuffer rollout(spec, steps, envs, 8);

  torch::Tensor hidden = torch::zeros({envs, 8}), mean;
  const ObservationTensors seen{{"pointgoal", torch::ones({envs, 2})}};
  bool fresh = true;
  for (int update = 0; update < 300; ++update) {
    {
      const torch::NoGradGuard no_gradient;
      rollout.begin(hidden);
      for (int t = 0; t < steps; ++t) {
        const torch::Tensor not_done = torch::full({envs}, fresh ? 0.f : 1.f);
        const PolicyOutput output = policy->step(seen, hidden, not_done);
        const torch::Tensor action = torch::zeros({envs}, torch::kInt64);
        rollout.push(seen, not_done, action, log_probabilities(output.logits, action), output.value);
        fresh = t % episode_steps == episode_steps - 1;
        // V of the final observation, with the state after this row.
        const torch::Tensor final_value = fresh ? policy->step(seen, output.hidden, torch::ones({envs})).value : torch::zeros({envs});
        const std::vector<std::uint8_t> out_of_time(envs, fresh), no(envs, 0), yes(envs, 1);
        rollout.push_outcome(std::vector<float>(envs, 1.f), truncation_bootstraps ? no : out_of_time,
                             truncation_bootstraps ? out_of_time : no, final_value, yes);
        hidden = output.hidden;
      }
      rollout.finish(policy->step(seen, hidden, torch::full({envs}, fresh ? 0.f : 1.f)).value);
    }
    mean = rollout.values.mean();
    learner.update(rollout, 0, static_cast<std::uint64_t>(update), kAlone);
  }
  return mean.item<double>();
}

TEST(Learning, TruncationDoesNotShortenTheFuture) {
  // Every state earns 1 / (1 - 0.9) = 10.
  EXPECT_NEAR(learned_value(true), 10.0, 0.3);
  // Time-out taken for the end: (1 - 0.9^k) / (1 - 0.9) with k = 1 ... 5 steps to go: 1, 1.9, 2.71, 3.439, 4.0951; mean 2.6288.
  EXPECT_NEAR(learned_value(false), 2.6288, 0.3);
}

}  // namespace
}  // namespace earshot
