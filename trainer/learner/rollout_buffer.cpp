// SPDX-License-Identifier: Apache-2.0
#include "trainer/learner/rollout_buffer.h"

#include <algorithm>
#include <cmath>

#include "sim/base/errors.h"

namespace earshot {
namespace {

torch::Tensor flags(std::span<const std::uint8_t> bytes) {
  torch::Tensor tensor = torch::empty({static_cast<std::int64_t>(bytes.size())}, torch::kFloat32);
  float* row = tensor.data_ptr<float>();
  for (std::size_t i = 0; i < bytes.size(); ++i) row[i] = bytes[i] ? 1.f : 0.f;
  return tensor;
}

}  // namespace

RolloutBuffer::RolloutBuffer(const ObservationSpec& spec, int max_steps, int num_envs, int hidden_size) : num_envs_(num_envs) {
  EARSHOT_EXPECT(max_steps > 0 && num_envs > 0 && hidden_size > 0);
  const std::int64_t T = max_steps, B = num_envs;
  for (const SensorSpec& sensor : sensor_table(spec, 1))
    observations.add(sensor.name, torch::zeros(sizes_of(sensor, {T, B}), scalar_type(sensor.type)));
  hidden = torch::zeros({B, hidden_size});
  for (torch::Tensor* slab : {&not_done, &log_prob, &values, &rewards, &terminated, &truncated, &final_values, &valid, &guided})
    *slab = torch::zeros({T, B});
  actions = torch::zeros({T, B}, torch::kInt64);
  next_value = torch::zeros({B});
}

RolloutBuffer RolloutBuffer::columns(int first, int count) const {
  RolloutBuffer part = *this;
  part.num_envs_ = count;
  part.observations = observations.map([&](const torch::Tensor& slab) { return slab.narrow(1, first, count); });
  for (torch::Tensor RolloutBuffer::*slab :
       {&RolloutBuffer::not_done, &RolloutBuffer::actions, &RolloutBuffer::log_prob, &RolloutBuffer::values, &RolloutBuffer::rewards,
        &RolloutBuffer::terminated, &RolloutBuffer::truncated, &RolloutBuffer::final_values, &RolloutBuffer::valid, &RolloutBuffer::guided})
    part.*slab = (this->*slab).narrow(1, first, count);
  part.hidden = hidden.narrow(0, first, count);
  part.next_value = next_value.narrow(0, first, count);
  return part;
}

void RolloutBuffer::begin(const torch::Tensor& state) {
  EARSHOT_EXPECT(state.sizes() == hidden.sizes());  // copy_ would broadcast
  hidden.copy_(state.detach());
  steps_ = 0;
}

void RolloutBuffer::push(const ObservationTensors& seen, const torch::Tensor& continues, const torch::Tensor& chosen,
                         const torch::Tensor& chosen_log_prob, const torch::Tensor& value, const torch::Tensor& by_oracle) {
  EARSHOT_EXPECT(steps_ < rewards.size(0) && continues.numel() == num_envs_ && chosen.numel() == num_envs_);
  EARSHOT_EXPECT(chosen_log_prob.numel() == num_envs_ && value.numel() == num_envs_);
  for (const auto& [name, slab] : observations.sensors) {
    const torch::Tensor& row = seen[name];
    EARSHOT_EXPECT(row.defined() && row.sizes() == slab[0].sizes() && row.scalar_type() == slab.scalar_type());
  }
  const torch::NoGradGuard no_gradient;
  for (auto& [name, slab] : observations.sensors) slab[steps_].copy_(seen[name]);
  not_done[steps_].copy_(continues);
  actions[steps_].copy_(chosen);
  log_prob[steps_].copy_(chosen_log_prob);
  values[steps_].copy_(value);
  if (by_oracle.defined())
    guided[steps_].copy_(by_oracle);
  else
    guided[steps_].zero_();
}

void RolloutBuffer::push_outcome(std::span<const float> reward, std::span<const std::uint8_t> ended,
                                 std::span<const std::uint8_t> timed_out, const torch::Tensor& final_value,
                                 std::span<const std::uint8_t> counts) {
  EARSHOT_EXPECT(steps_ < rewards.size(0) && std::ssize(reward) == num_envs_ && std::ssize(ended) == num_envs_);
  EARSHOT_EXPECT(std::ssize(timed_out) == num_envs_ && std::ssize(counts) == num_envs_ && final_value.numel() == num_envs_);
  const torch::NoGradGuard no_gradient;
  std::copy(reward.begin(), reward.end(), rewards[steps_].data_ptr<float>());
  terminated[steps_].copy_(flags(ended));
  truncated[steps_].copy_(flags(timed_out));
  final_values[steps_].copy_(final_value);
  valid[steps_].copy_(flags(counts));
  const auto row = [&](const torch::Tensor& slab) { return slab[steps_].data_ptr<float>(); };
  const float *r = row(rewards), *v = row(values), *p = row(log_prob), *f = row(final_values);
  for (std::int64_t env = 0; env < num_envs_; ++env) {
    const auto i = static_cast<std::size_t>(env);
    const bool bootstraps = timed_out[i] != 0 && ended[i] == 0;  // gae() reads no other final value
    // The row before leads to this row's value, unless an episode ended there.
    if (!std::isfinite(v[i]) && steps_ > 0 && terminated[steps_ - 1][env].item<float>() == 0 &&
        truncated[steps_ - 1][env].item<float>() == 0)
      drop(steps_ - 1, env);
    if (!std::isfinite(r[i]) || !std::isfinite(v[i]) || !std::isfinite(p[i]) || (bootstraps && !std::isfinite(f[i]))) drop(steps_, env);
  }
  ++steps_;
}

void RolloutBuffer::drop(std::int64_t step, std::int64_t env) {
  if (valid[step][env].item<float>() != 0) ++dropped_rows_;
  valid[step][env] = 0;
  // Finite values stay: the previous row may still bootstrap from the value of this row.
  for (torch::Tensor* slab : {&rewards, &values, &log_prob, &final_values}) {
    float& number = (*slab)[step].data_ptr<float>()[env];
    if (!std::isfinite(number)) number = 0;
  }
}

void RolloutBuffer::finish(const torch::Tensor& value) {
  EARSHOT_EXPECT(steps_ > 0 && value.numel() == num_envs_);
  const torch::NoGradGuard no_gradient;
  next_value.copy_(value);
  // Without the value after the last row, the return of that row is unknown.
  for (std::int64_t env = 0; env < num_envs_; ++env)
    if (!std::isfinite(next_value.data_ptr<float>()[env])) {
      next_value[env] = 0;
      const bool ended = terminated[steps_ - 1][env].item<float>() != 0 || truncated[steps_ - 1][env].item<float>() != 0;
      if (!ended) drop(steps_ - 1, env);
    }
}

}  // namespace earshot
