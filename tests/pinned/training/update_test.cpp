// SPDX-License-Identifier: Apache-2.0
#include <fmt/format.h>
#include <gtest/gtest.h>
#include <torch/version.h>

#include <cctype>
#include <string>
#include <vector>

#include "policy/action_distribution.h"
#include "policy/actor_critic.h"
#include "policy/torch_kernels.h"
#include "sim/base/random.h"
#include "tests/support/files/pinned_bits.h"
#include "trainer/learner/ppo.h"

namespace earshot {
namespace {

ObservationSpec small_spec() {
  ObservationSpec spec;
  spec.camera.width_px = spec.camera.height_px = 64;
  spec.pointgoal = true;
  return spec;
}

torch::Tensor uniform(std::vector<std::int64_t> shape, std::uint32_t item) {
  const torch::Tensor values = torch::empty(shape);
  const RandomStream random(11, Purpose::test, item);
  float* data = values.data_ptr<float>();
  for (std::int64_t i = 0; i < values.numel(); ++i) data[i] = random.uniform2(static_cast<std::uint32_t>(i))[0];
  return values;
}

/// A rollout that the policy could have made, of drawn observations and rewards.
RolloutBuffer drawn_rollout(ActorCritic policy, const ObservationSpec& spec, int steps, int envs) {
  const torch::NoGradGuard no_gradient;
  RolloutBuffer rollout(spec, steps, envs, policy->hidden_size());
  torch::Tensor hidden = torch::zeros({envs, policy->hidden_size()}), not_done = torch::ones({envs});
  rollout.begin(hidden);
  for (int t = 0; t < steps; ++t) {
    const auto item = static_cast<std::uint32_t>(10 * t);
    const ObservationTensors seen{{"depth", uniform({envs, 64, 64, 1}, item)},
                                  {"spectrogram", uniform({envs, spec.sound.rows(), spec.sound.columns(), 2}, item + 1)},
                                  {"pointgoal", uniform({envs, 2}, item + 2)}};
    const PolicyOutput output = policy->step(seen, hidden, not_done);
    const torch::Tensor actions = (uniform({envs}, item + 3) * 4).to(torch::kInt64).clamp(0, 3);
    rollout.push(seen, not_done, actions, log_probabilities(output.logits, actions), output.value);
    std::vector<float> rewards(static_cast<std::size_t>(envs));
    std::vector<std::uint8_t> terminated(rewards.size()), truncated(rewards.size()), valid(rewards.size(), 1);
    const torch::Tensor drawn = uniform({envs}, item + 4);
    for (std::size_t e = 0; e < rewards.size(); ++e) {
      rewards[e] = drawn.data_ptr<float>()[e] - 0.5f;
      terminated[e] = t == 3 && e == 1;
      truncated[e] = t == 5 && e == 0;
    }
    rollout.push_outcome(rewards, terminated, truncated, uniform({envs}, item + 5), valid);
    hidden = output.hidden;
    not_done = torch::ones({envs});
    if (t == 3) not_done[1] = 0;
    if (t == 5) not_done[0] = 0;
  }
  rollout.finish(uniform({envs}, 9999));
  return rollout;
}

/// "libtorch1.13/Haswell": the second is the processor whose kernels OpenBLAS has chosen, "blas" for another library.
std::string torch_and_blas(const TorchKernels& kernels) {
  return fmt::format("libtorch{}.{}/{}", TORCH_VERSION_MAJOR, TORCH_VERSION_MINOR, kernels.blas.empty() ? "blas" : kernels.blas);
}

/// "avx2": instructions of libtorch's own kernels; "avx2+onednn_avx512" where oneDNN's are others.
std::string vectors(const TorchKernels& kernels) {
  std::string name = kernels.libtorch;
  for (char& c : name) c = static_cast<char>(std::tolower(static_cast<unsigned char>(c)));
  return kernels.onednn.empty() || kernels.onednn == name ? name : name + "+onednn_" + kernels.onednn;
}

TEST(PinnedBits, OnePpoUpdate) {
  const ObservationSpec spec = small_spec();
  PolicyConfig config;
  config.hidden_size = 64;
  config.visual_features = config.audio_features = 32;
  config.conv_channels = 8;
  config.seed = 3;
  ActorCritic policy(spec, config);
  const RolloutBuffer rollout = drawn_rollout(policy, spec, 8, 4);
  PpoLearner learner(policy, PpoConfig{}, 1);
  const auto alone = make_single_worker();
  const UpdateStats stats = learner.update(rollout, 0, 0, *alone);
  EXPECT_EQ(stats.taken_steps, 4);
  pinned::BitHash bits;
  for (const torch::Tensor& parameter : policy->parameters()) {
    const torch::Tensor values = parameter.detach().contiguous();
    bits.add(std::span<const float>(values.data_ptr<float>(), static_cast<std::size_t>(values.numel())));
  }
  const TorchKernels kernels = torch_kernels();
  pinned::expect_pinned({"ppo_update", pinned::toolchain({torch_and_blas(kernels)}), pinned::processor_with(vectors(kernels))}, bits);
}

}  // namespace
}  // namespace earshot
