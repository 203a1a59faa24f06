#include "trainer/actor.h"

namespace earshot {
namespace {

torch::Tensor view(std::span<const float> values, std::vector<std::int64_t> shape) {
  if (values.empty()) return {};
  // from_blob wants a mutable pointer; nobody writes through these views.
  return torch::from_blob(const_cast<float*>(values.data()), shape, torch::kFloat32);
}

ObservationTensors views(const BatchedEnv& env, std::span<const float> depth, std::span<const float> spectrogram, std::span<const float> pointgoal) {
  const ObservationSpec& spec = env.config().observation;
  const std::int64_t n = env.num_envs();
  return {view(depth, {n, spec.camera.height_px, spec.camera.width_px, 1}), view(spectrogram, {n, spec.sound.rows(), spec.sound.columns(), 2}),
          view(pointgoal, {n, 2})};
}

}  // namespace

ObservationTensors observation_tensors(const BatchedEnv& env) { return views(env, env.depth(), env.spectrogram(), env.pointgoal()); }

ObservationTensors final_observation_tensors(const BatchedEnv& env) {
  return views(env, env.final_depth(), env.final_spectrogram(), env.final_pointgoal());
}

Actor::Actor(ActorCritic policy, int num_envs)
    : policy_(std::move(policy)), hidden_(torch::zeros({num_envs, policy_->hidden_size()})), not_done_(torch::zeros({num_envs})) {}

const PolicyOutput& Actor::observe(const BatchedEnv& env) {
  const torch::NoGradGuard no_grad;
  output_ = policy_->step(observation_tensors(env), hidden_, not_done_);
  return output_;
}

torch::Tensor Actor::truncated_values(const BatchedEnv& env) {
  torch::Tensor values = torch::zeros({env.num_envs()});
  std::vector<std::int64_t> rows;
  for (int i = 0; i < env.num_envs(); ++i)
    if (env.truncated()[i] != 0 && env.terminated()[i] == 0) rows.push_back(i);
  if (rows.empty()) return values;
  const torch::NoGradGuard no_grad;
  const torch::Tensor index = torch::tensor(rows);
  ObservationTensors last = final_observation_tensors(env);
  for (torch::Tensor* sensor : {&last.depth, &last.spectrogram, &last.pointgoal})
    if (sensor->defined()) *sensor = sensor->index_select(0, index);
  const auto count = static_cast<std::int64_t>(rows.size());
  const PolicyOutput output = policy_->step(last, output_.hidden.index_select(0, index), torch::ones({count}));
  values.index_copy_(0, index, output.value);
  return values;
}

void Actor::advance(const BatchedEnv& env) {
  hidden_ = output_.hidden;
  for (int i = 0; i < env.num_envs(); ++i) not_done_[i] = env.terminated()[i] != 0 || env.truncated()[i] != 0 ? 0.f : 1.f;
}

torch::Tensor Actor::peek_value(const BatchedEnv& env) {
  const torch::NoGradGuard no_grad;
  return policy_->step(observation_tensors(env), hidden_, not_done_).value;
}

void Actor::restore(const torch::Tensor& hidden, const torch::Tensor& not_done) {
  hidden_ = hidden.clone();
  not_done_ = not_done.clone();
}

}  // namespace earshot
