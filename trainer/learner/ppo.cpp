// SPDX-License-Identifier: Apache-2.0
#include "trainer/learner/ppo.h"

#include <algorithm>
#include <array>
#include <chrono>
#include <cmath>
#include <limits>
#include <numeric>
#include <utility>
#include <vector>

#include "policy/action_distribution.h"
#include "sim/base/denormals.h"
#include "sim/base/errors.h"
#include "sim/base/files.h"
#include "sim/base/random.h"
#include "trainer/learner/adam_kernel.h"
#include "trainer/learner/advantage_normalization.h"
#include "trainer/learner/gae.h"
#include "trainer/learner/guidance_loss.h"
#include "trainer/learner/optimizer_key.h"
#include "trainer/learner/value_scale.h"

namespace earshot {
namespace {

double seconds_since(std::chrono::steady_clock::time_point start) {
  return std::chrono::duration<double>(std::chrono::steady_clock::now() - start).count();
}

/// Fisher and Yates 1938: a permutation of the envs as a function of (seed, update, epoch).
std::vector<std::int64_t> permutation(int count, std::uint64_t seed, std::uint64_t update, int epoch) {
  std::vector<std::int64_t> order(static_cast<std::size_t>(count));
  std::iota(order.begin(), order.end(), std::int64_t{0});
  const RandomStream random(seed, Purpose::minibatch, static_cast<std::uint32_t>(update), static_cast<std::uint32_t>(update >> 32),
                            static_cast<std::uint32_t>(epoch));
  for (std::size_t left = order.size(); left > 1; --left)
    std::swap(order[left - 1], order[random.below(static_cast<std::uint32_t>(left), static_cast<std::uint32_t>(left))]);
  return order;
}

torch::Tensor index_of(std::span<const std::int64_t> envs) {
  return torch::tensor(torch::ArrayRef<std::int64_t>(envs.data(), envs.size()));
}

/// In float64: the square of a float cannot overflow it, so the sum is finite if and only if every element is.  Eight partial sums in a
/// fixed order, so that the compiler may use vector registers.
double sum_of_squares(std::span<const float> values) {
  std::array<double, 8> lanes{};
  std::size_t i = 0;
  for (; i + lanes.size() <= values.size(); i += lanes.size())
    for (std::size_t lane = 0; lane < lanes.size(); ++lane) {
      const double value = values[i + lane];
      lanes[lane] += value * value;
    }
  for (; i < values.size(); ++i) lanes[0] += static_cast<double>(values[i]) * static_cast<double>(values[i]);
  return std::accumulate(lanes.begin(), lanes.end(), 0.0);
}

/// 1 - Var[R - V] / Var[R].
double explained_variance(const torch::Tensor& values, const torch::Tensor& returns, const torch::Tensor& valid) {
  const torch::Tensor v = values.masked_select(valid).to(torch::kFloat64), r = returns.masked_select(valid).to(torch::kFloat64);
  if (r.numel() < 2) return std::numeric_limits<double>::quiet_NaN();
  const double variance = r.var(false).item<double>();
  return variance > 0 ? 1 - (r - v).var(false).item<double>() / variance : std::numeric_limits<double>::quiet_NaN();
}

/// The state of a parameter in torch's Adam, created if absent.
torch::optim::AdamParamState& state_of(torch::optim::Adam& optimizer, const torch::Tensor& parameter) {
  auto& state = optimizer.state()[optimizer_key(parameter)];
  if (!state) {
    auto begun = std::make_unique<torch::optim::AdamParamState>();
    begun->exp_avg(torch::zeros_like(parameter, at::MemoryFormat::Contiguous));
    begun->exp_avg_sq(torch::zeros_like(parameter, at::MemoryFormat::Contiguous));
    state = std::move(begun);
  }
  return static_cast<torch::optim::AdamParamState&>(*state);
}

std::span<float> elements_of(torch::Tensor& tensor) {
  EARSHOT_EXPECT(tensor.is_contiguous());
  return {tensor.data_ptr<float>(), static_cast<std::size_t>(tensor.numel())};
}

/// Of this worker's mean in that of all: in units of a whole rollout, so that it is exactly 1 where all made all steps, and cancels.
float weight_of(const RolloutBuffer& rollout, PreemptWeight rule, Collective& collective) {
  const int world_size = collective.identity().world_size;
  if (world_size == 1 || rule == PreemptWeight::worker) return 1.f;
  double steps = rollout.num_steps();
  if (rule == PreemptWeight::truncated) {
    double mean = steps;
    collective.all_reduce_sum(std::span(&mean, 1));
    steps = std::min(steps, mean / world_size);  // samples times min(1, mean / samples)
  }
  return static_cast<float>(steps / static_cast<double>(rollout.actions.size(0)));
}

/// From the statuses, so that every worker counts the same.
void raise_alarms(std::span<const StepStatus> statuses, const PpoConfig& config, UpdateStats& stats) {
  for (std::size_t rank = 0; rank < statuses.size(); ++rank) {
    const StepStatus& status = statuses[rank];
    const bool loss = std::abs(status.loss) > config.loss_alarm, kl = status.approx_kl > config.kl_alarm;
    stats.loss_alarms += loss;
    stats.kl_alarms += kl;
    if (!(loss || kl) || stats.alarm_rank >= 0) continue;
    stats.alarm_rank = static_cast<int>(rank);
    stats.alarm_loss = status.loss;
    stats.alarm_kl = status.approx_kl;
  }
}

}  // namespace

PpoLoss ppo_loss(const torch::Tensor& log_prob, const torch::Tensor& old_log_prob, const torch::Tensor& advantages,
                 const torch::Tensor& values, const torch::Tensor& old_values, const torch::Tensor& returns, const torch::Tensor& entropy,
                 const torch::Tensor& valid, double clip, const PpoConfig& config) {
  for (const torch::Tensor* rows : {&old_log_prob, &advantages, &values, &old_values, &returns, &entropy, &valid})
    EARSHOT_EXPECT(rows->sizes() == log_prob.sizes());
  // Selected before any arithmetic: multiplying by a mask afterwards would let NaN through, in the loss or in the gradient.
  const torch::Tensor counts = valid.to(torch::kBool);
  const auto select = [&](const torch::Tensor& rows) { return rows.masked_select(counts); };
  const double weight = 1.0 / static_cast<double>(std::max<std::int64_t>(1, counts.sum().item<std::int64_t>()));
  const auto mean = [&](const torch::Tensor& rows) { return rows.sum() * weight; };

  // exp(89) is infinite in float32, and infinity times an advantage of 0 is NaN.
  const torch::Tensor log_ratio = (select(log_prob) - select(old_log_prob)).clamp(-20, 20);
  const torch::Tensor ratio = log_ratio.exp();
  const torch::Tensor advantage = select(advantages);
  const torch::Tensor policy = -mean(torch::min(ratio * advantage, ratio.clamp(1 - clip, 1 + clip) * advantage));

  const torch::Tensor value = select(values), old_value = select(old_values), target = select(returns);
  torch::Tensor squared_error = (value - target).square();
  if (config.clip_value_loss)
    squared_error = torch::max(squared_error, (old_value + (value - old_value).clamp(-clip, clip) - target).square());
  const torch::Tensor value_loss = 0.5 * mean(squared_error);

  const torch::Tensor mean_entropy = mean(select(entropy));
  return {.total = policy + config.value_coefficient * value_loss - config.entropy_coefficient * mean_entropy,
          .policy = policy,
          .value = value_loss,
          .entropy = mean_entropy,
          .approx_kl = mean(ratio - 1 - log_ratio).detach(),
          .clip_fraction = mean(((ratio - 1).abs() > clip).to(log_prob.scalar_type())).detach()};
}

struct PpoLearner::Rollout {
  ObservationTensors observations;                                                // [T, B, ...]
  torch::Tensor hidden;                                                           // [B, hidden_size]
  torch::Tensor not_done, actions, log_prob, values, advantages, returns, valid;  // [T, B]
  torch::Tensor own;                                                              // [T, B] valid, and the policy itself chose the action
  float weight = 1;                                                               // of this worker's mean in that of all

  Rollout(const RolloutBuffer& buffer, const GaeConfig& config) {
    const auto rows = [&](const torch::Tensor& slab) { return slab.slice(0, 0, buffer.num_steps()); };
    observations = buffer.observations.map(rows);
    hidden = buffer.hidden;
    not_done = rows(buffer.not_done);
    actions = rows(buffer.actions);
    log_prob = rows(buffer.log_prob);
    values = rows(buffer.values);
    valid = rows(buffer.valid).to(torch::kBool);
    own = valid.logical_and(rows(buffer.guided).to(torch::kBool).logical_not());
    // In float64 until the loss: the return is rounded once.
    advantages = gae(rows(buffer.rewards).to(torch::kFloat64), values, rows(buffer.terminated), rows(buffer.truncated),
                     rows(buffer.final_values), buffer.next_value, config, valid);
    returns = (advantages + values.to(torch::kFloat64)).to(values.scalar_type());
  }
};

PpoLearner::PpoLearner(PolicyNetwork policy, const PpoConfig& config, std::uint64_t seed, const GuidanceConfig& guidance, double near_m)
    : policy_(std::move(policy)),
      config_(config),
      guidance_(guidance),
      near_m_(near_m),
      optimizer_(policy_->parameters(), torch::optim::AdamOptions(config.learning_rate).eps(config.adam_epsilon)),
      seed_(seed),
      flat_gradient_(torch::zeros({policy_->num_parameters() + 1})) {
  std::int64_t first = 0;
  for (torch::Tensor& parameter : policy_->parameters()) {
    parameter.mutable_grad() = flat_gradient_.narrow(0, first, parameter.numel()).view(parameter.sizes());
    first += parameter.numel();
  }
}

PpoLoss PpoLearner::minibatch_loss(const Rollout& rollout, std::span<const std::int64_t> envs, double progress, bool is_first_minibatch,
                                   UpdateStats& stats) {
  const torch::Tensor index = index_of(envs);
  const auto rows = [&](const torch::Tensor& slab) {  // [T, B, ...] -> [T * envs, ...]
    return slab.index_select(1, index).flatten(0, 1);
  };
  const PolicyOutput output =
      policy_->sequence(rollout.observations.map(rows), rollout.hidden.index_select(0, index), rollout.not_done.index_select(1, index));
  const torch::Tensor log_prob = log_probabilities(output.logits, rows(rollout.actions));
  const torch::Tensor old_log_prob = rows(rollout.log_prob), valid = rows(rollout.valid), own = rows(rollout.own);
  if (is_first_minibatch && valid.any().item<bool>())
    stats.max_ratio_error = ((log_prob - old_log_prob).detach().masked_select(valid).exp() - 1).abs().max().item<double>();

  const double left = 1.0 - progress;
  PpoConfig now = config_;
  if (config_.linear_entropy_decay) now.entropy_coefficient *= left;
  // Errors and the clip of values count in the critic's own unit.
  const auto in_unit = [&](const torch::Tensor& values) {
    return policy_->normalizes_values() ? values / policy_->value_deviation() : values;
  };
  PpoLoss loss =
      ppo_loss(log_prob, old_log_prob, rows(rollout.advantages), in_unit(output.value), in_unit(rows(rollout.values)),
               in_unit(rows(rollout.returns)), entropy(output.logits), own, config_.clip * (config_.linear_clip_decay ? left : 1.0), now);
  if (const double weight = guidance_.imitation_at(progress); weight > 0) {
    const torch::Tensor oracle = rows(rollout.observations["oracle_action"]);
    loss.imitation = imitation_loss(output.logits, oracle, valid);
    loss.total = loss.total + weight * loss.imitation;
    if (is_first_minibatch && valid.any().item<bool>())
      stats.oracle_agreement = output.logits.argmax(1).eq(oracle.squeeze(1)).masked_select(valid).to(torch::kFloat64).mean().item<double>();
  }
  if (guidance_.goal > 0) {
    loss.goal = goal_loss(output.goal, rows(rollout.observations["goal_state"]), near_m_, valid);
    loss.total = loss.total + guidance_.goal * loss.goal;
  }
  return loss;
}

StepStatus PpoLearner::accumulate_gradient(const Rollout& rollout, std::span<const std::int64_t> envs, double progress,
                                           bool is_first_minibatch, UpdateStats& stats) {
  const std::span<float> gradient(flat_gradient_.data_ptr<float>(), static_cast<std::size_t>(flat_gradient_.numel()));
  const torch::Tensor& counts = guidance_.imitation_at(progress) > 0 || guidance_.goal > 0 ? rollout.valid : rollout.own;
  const bool has_rows = !envs.empty() && counts.index_select(1, index_of(envs)).any().item<bool>();
  flat_gradient_.zero_();
  gradient.back() = has_rows ? rollout.weight : 0.f;
  StepStatus status;
  if (!has_rows) return status;

  const auto start = std::chrono::steady_clock::now();
  const PpoLoss loss = minibatch_loss(rollout, envs, progress, is_first_minibatch, stats);
  stats.forward_s += seconds_since(start);
  const auto backward_start = std::chrono::steady_clock::now();
  (rollout.weight == 1.f ? loss.total : loss.total * rollout.weight).backward();
  stats.backward_s += seconds_since(backward_start);
  status.loss = loss.total.item<double>();
  status.approx_kl = loss.approx_kl.item<double>();
  status.finite_here = std::isfinite(status.loss) && std::isfinite(status.approx_kl) && std::isfinite(sum_of_squares(gradient));
  if (!status.finite_here) {
    ++stats.non_finite_here;
    return status;
  }
  stats.policy_loss += loss.policy.item<double>();
  stats.value_loss += loss.value.item<double>();
  stats.entropy += loss.entropy.item<double>();
  stats.approx_kl += status.approx_kl;
  stats.clip_fraction += loss.clip_fraction.item<double>();
  if (loss.imitation.defined()) stats.imitation_loss += loss.imitation.item<double>();
  if (loss.goal.defined()) stats.goal_loss += loss.goal.item<double>();
  return status;
}

UpdateStats PpoLearner::update(const RolloutBuffer& buffer, double progress, std::uint64_t update, Collective& collective) {
  EARSHOT_EXPECT(buffer.num_steps() > 0 && buffer.num_envs() > 0);
  const FlushDenormals flush;
  const auto start = std::chrono::steady_clock::now();
  UpdateStats stats;
  const double left = std::clamp(1.0 - progress, 0.0, 1.0);
  for (auto& group : optimizer_.param_groups())
    static_cast<torch::optim::AdamOptions&>(group.options()).lr(config_.learning_rate * (config_.linear_learning_rate_decay ? left : 1.0));

  Rollout rollout(buffer, config_.gae);
  rollout.weight = weight_of(buffer, config_.preempt_weight, collective);
  stats.explained_variance = explained_variance(rollout.values, rollout.returns, rollout.own);
  if (config_.normalize_advantages) rollout.advantages = normalize_advantages(rollout.advantages, rollout.own, collective);
  if (policy_->normalizes_values()) follow_returns(policy_, rollout.returns, rollout.own, update, collective);
  rollout.advantages = rollout.advantages.to(rollout.values.scalar_type());

  const std::size_t num_envs = static_cast<std::size_t>(buffer.num_envs()), minibatches = static_cast<std::size_t>(config_.minibatches);
  const std::span<float> gradient(flat_gradient_.data_ptr<float>(), static_cast<std::size_t>(flat_gradient_.numel()));
  int counted = 0;
  for (int epoch = 0; epoch < config_.epochs; ++epoch) {
    const std::vector<std::int64_t> order = permutation(buffer.num_envs(), seed_, update, epoch);
    ++stats.epochs;
    double epoch_kl = 0;  // of all workers, so that all end alike
    for (std::size_t minibatch = 0; minibatch < minibatches; ++minibatch) {
      const std::size_t first = minibatch * num_envs / minibatches, end = (minibatch + 1) * num_envs / minibatches;
      StepStatus mine =
          accumulate_gradient(rollout, std::span(order).subspan(first, end - first), 1.0 - left, epoch == 0 && minibatch == 0, stats);
      counted += gradient.back() > 0 && mine.finite_here;
      collective.note_progress();

      const auto reduce_start = std::chrono::steady_clock::now();
      collective.all_reduce_sum(gradient);
      const double squared_sum = sum_of_squares(gradient.first(gradient.size() - 1));
      mine.finite_sum = std::isfinite(squared_sum) && std::isfinite(gradient.back());
      if (collective.identity().world_size > 1) mine.sum_hash = hash64(std::as_bytes(gradient));
      const std::vector<StepStatus> statuses = exchange_status(mine, collective);
      stats.reduce_s += seconds_since(reduce_start);

      for (const StepStatus& status : statuses) epoch_kl += status.approx_kl / static_cast<double>(statuses.size() * minibatches);
      raise_alarms(statuses, config_, stats);
      StepDecision decision = decide(statuses);
      if (!decision.take) {
        stats.skipped.push_back({epoch, static_cast<int>(minibatch), decision.cause, std::move(decision.faulty_ranks)});
      } else if (gradient.back() > 0) {  // a rank had rows; else Adam would still move along its moments
        const auto step_start = std::chrono::steady_clock::now();
        stats.gradient_norm += clip_and_step(squared_sum);
        stats.step_s += seconds_since(step_start);
        ++stats.taken_steps;
      }
    }
    if (config_.target_kl > 0 && epoch_kl > config_.target_kl) break;
  }
  for (double* mean : {&stats.policy_loss, &stats.value_loss, &stats.entropy, &stats.approx_kl, &stats.clip_fraction, &stats.imitation_loss,
                       &stats.goal_loss})
    *mean /= std::max(1, counted);
  stats.gradient_norm /= std::max(1, stats.taken_steps);
  stats.skipped_steps = static_cast<int>(stats.skipped.size());
  stats.learn_s = seconds_since(start) - stats.reduce_s;
  return stats;
}

double PpoLearner::clip_and_step(double squared_sum) {
  // Beside the sum of the gradients stands that of the weights of the workers that had rows: their quotient is the mean over those.
  const double weight = flat_gradient_.data_ptr<float>()[flat_gradient_.numel() - 1];
  const double norm = std::sqrt(squared_sum) / weight;
  const double scale = std::min(1.0, config_.max_gradient_norm / (norm + 1e-6)) / weight;
  for (auto& group : optimizer_.param_groups()) {
    const auto& options = static_cast<const torch::optim::AdamOptions&>(group.options());
    const AdamRates rates{.learning_rate = options.lr(),
                          .beta1 = std::get<0>(options.betas()),
                          .beta2 = std::get<1>(options.betas()),
                          .epsilon = options.eps()};
    for (torch::Tensor& parameter : group.params()) {
      torch::optim::AdamParamState& state = state_of(optimizer_, parameter);
      state.step(state.step() + 1);
      torch::Tensor first = state.exp_avg(), second = state.exp_avg_sq(), weights = parameter.detach();
      adam_step(rates, state.step(), scale, elements_of(parameter.mutable_grad()), elements_of(first), elements_of(second),
                elements_of(weights));
    }
  }
  return norm;
}

}  // namespace earshot
