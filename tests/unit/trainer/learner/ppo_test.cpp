// SPDX-License-Identifier: Apache-2.0
// The loss as a pure function; the learner is in ppo_learner_test.cpp.
#include "trainer/learner/ppo.h"

#include <gtest/gtest.h>

#include <cmath>
#include <limits>
#include <string>
#include <vector>

#include "sim/base/errors.h"

namespace earshot {
namespace {

using Row = std::vector<double>;

torch::Tensor tensor_of(const Row& values) { return torch::tensor(values, torch::kFloat64); }

struct Rows {
  Row log_prob, old_log_prob, advantages, values, old_values, returns, entropy, valid;
};

struct Result {
  double total, policy, value, entropy, approx_kl, clip_fraction;
  Row by_log_prob, by_value, by_entropy;  // gradients of total
};

Row list(const torch::Tensor& tensor) { return {tensor.data_ptr<double>(), tensor.data_ptr<double>() + tensor.numel()}; }

Result evaluate(const Rows& rows, double clip, const PpoConfig& config) {
  torch::Tensor log_prob = tensor_of(rows.log_prob).requires_grad_(true), values = tensor_of(rows.values).requires_grad_(true),
                entropy = tensor_of(rows.entropy).requires_grad_(true);
  const PpoLoss loss = ppo_loss(log_prob, tensor_of(rows.old_log_prob), tensor_of(rows.advantages), values, tensor_of(rows.old_values),
                                tensor_of(rows.returns), entropy, tensor_of(rows.valid), clip, config);
  loss.total.backward();
  return {loss.total.item<double>(),   loss.policy.item<double>(),    loss.value.item<double>(),
          loss.entropy.item<double>(), loss.approx_kl.item<double>(), loss.clip_fraction.item<double>(),
          list(log_prob.grad()),       list(values.grad()),           list(entropy.grad())};
}

PpoConfig policy_only() {
  PpoConfig config;
  config.value_coefficient = config.entropy_coefficient = 0;
  return config;
}

TEST(PpoLoss, NineCellsOfTheClippedSurrogate) {
  // clip = 0.2.  surrogate = min(r A, clip(r) A); its slope along log r is r A where the first is the smaller or both are the same, else 0.
  struct Cell {
    double ratio, advantage, surrogate, slope;
  };
  const std::vector<Cell> cells{
      {0.5, -2, -1.6, 0},   // min(-1, 0.8 * -2): already less likely than the clip allows: no push
      {1.0, -2, -2.0, -2},  // inside
      {1.5, -2, -3.0, -3},  // min(-3, 1.2 * -2): must become less likely: full push
      {0.5, 0, 0, 0},       //
      {1.0, 0, 0, 0},       //
      {1.5, 0, 0, 0},       // nothing to learn
      {0.5, 3, 1.5, 1.5},   // min(1.5, 0.8 * 3): must become more likely: full push
      {1.0, 3, 3.0, 3},     // inside
      {1.5, 3, 3.6, 0},     // min(4.5, 1.2 * 3): already more likely than the clip allows
  };
  Rows all;
  double sum = 0;
  for (const Cell& cell : cells) {
    const Rows single_row{{std::log(cell.ratio) - 1}, {-1}, {cell.advantage}, {0}, {0}, {0}, {0}, {1}};
    const Result result = evaluate(single_row, 0.2, policy_only());
    EXPECT_NEAR(result.policy, -cell.surrogate, 1e-12) << cell.ratio << " " << cell.advantage;
    EXPECT_NEAR(result.by_log_prob[0], -cell.slope, 1e-12) << cell.ratio << " " << cell.advantage;
    EXPECT_EQ(result.clip_fraction, cell.ratio == 1.0 ? 0 : 1);
    EXPECT_NEAR(result.approx_kl, cell.ratio - 1 - std::log(cell.ratio), 1e-12);
    sum += cell.surrogate;
    all.log_prob.push_back(std::log(cell.ratio) - 1);
    all.old_log_prob.push_back(-1);
    all.advantages.push_back(cell.advantage);
    for (Row* row : {&all.values, &all.old_values, &all.returns, &all.entropy}) row->push_back(0);
    all.valid.push_back(1);
  }
  const Result mean = evaluate(all, 0.2, policy_only());  // -(-1.6 - 2 - 3 + 1.5 + 3 + 3.6) / 9 = -1.5 / 9
  EXPECT_NEAR(mean.policy, -1.5 / 9, 1e-12);
  EXPECT_NEAR(mean.policy, -sum / 9, 1e-12);
  EXPECT_NEAR(mean.clip_fraction, 6.0 / 9, 1e-12);
}

TEST(PpoLoss, ValueLossWithAndWithoutClip) {
  struct Cell {
    double value, target, loss, slope;
    bool clipped;
  };
  // old value 1, clip 0.2: the clipped value stays in 0.8 ... 1.2.  loss = max of both squared errors / 2.
  const std::vector<Cell> cells{
      {1.1, 2, 0.405, -0.9, true},   // inside: (1.1 - 2)^2 / 2, slope v - R
      {1.5, 2, 0.32, 0, true},       // max((1.5 - 2)^2, (1.2 - 2)^2) = 0.64: it has moved far enough towards 2
      {1.5, 0, 1.125, 1.5, true},    // max(1.5^2, 1.2^2) = 2.25: it has moved the wrong way
      {0.5, 0, 0.32, 0, true},       // max(0.5^2, 0.8^2) = 0.64
      {0.5, 2, 1.125, -1.5, true},   // max(1.5^2, 1.2^2) = 2.25
      {1.5, 2, 0.125, -0.5, false},  // no clip: (1.5 - 2)^2 / 2
      {0.5, 0, 0.125, 0.5, false},
  };
  for (const Cell& cell : cells) {
    PpoConfig config;
    config.value_coefficient = 3;
    config.entropy_coefficient = 0;
    config.clip_value_loss = cell.clipped;
    const Result result = evaluate({{-1}, {-1}, {0}, {cell.value}, {1}, {cell.target}, {0}, {1}}, 0.2, config);
    EXPECT_NEAR(result.value, cell.loss, 1e-12) << cell.value << " " << cell.target;
    EXPECT_NEAR(result.total, 3 * cell.loss, 1e-12);
    EXPECT_NEAR(result.by_value[0], 3 * cell.slope, 1e-12) << cell.value << " " << cell.target;
  }
}

/// The loss of the header in plain loops.
double independent_total(const Rows& rows, double clip, const PpoConfig& config) {
  double policy = 0, value = 0, entropy = 0, count = 0;
  for (std::size_t i = 0; i < rows.valid.size(); ++i) {
    if (rows.valid[i] == 0) continue;
    const double ratio = std::exp(rows.log_prob[i] - rows.old_log_prob[i]);
    const double clipped = ratio < 1 - clip ? 1 - clip : ratio > 1 + clip ? 1 + clip : ratio;
    policy -= std::fmin(ratio * rows.advantages[i], clipped * rows.advantages[i]);
    const double moved = rows.values[i] - rows.old_values[i];
    const double near = rows.old_values[i] + (moved < -clip ? -clip : moved > clip ? clip : moved);
    const double error = std::pow(rows.values[i] - rows.returns[i], 2), near_error = std::pow(near - rows.returns[i], 2);
    value += 0.5 * (config.clip_value_loss ? std::fmax(error, near_error) : error);
    entropy += rows.entropy[i];
    count += 1;
  }
  return (policy + config.value_coefficient * value - config.entropy_coefficient * entropy) / count;
}

TEST(PpoLoss, GradientsEqualCentralDifferencesOfAnIndependentLoss) {
  torch::manual_seed(3);
  const auto normal = [](double scale) { return list(torch::randn({40}, torch::kFloat64) * scale); };
  Rows rows{normal(0.3), normal(0.3), normal(1), normal(0.4), normal(0.4), normal(0.4), normal(0.2), {}};
  for (int i = 0; i < 40; ++i) rows.valid.push_back(i % 5 == 2 ? 0 : 1);
  for (const bool clip_values : {true, false}) {
    PpoConfig config;
    config.value_coefficient = 0.7;
    config.entropy_coefficient = 0.03;
    config.clip_value_loss = clip_values;
    const Result result = evaluate(rows, 0.2, config);
    EXPECT_NEAR(result.total, independent_total(rows, 0.2, config), 1e-12);
    EXPECT_NEAR(result.total, result.policy + 0.7 * result.value - 0.03 * result.entropy, 1e-12);
    EXPECT_GT(result.clip_fraction, 0.2);  // both branches occur
    EXPECT_LT(result.clip_fraction, 0.8);
    const auto check = [&](Row Rows::*inputs, const Row& gradient) {
      for (std::size_t i = 0; i < gradient.size(); ++i) {
        Rows up = rows, down = rows;
        constexpr double h = 1e-6;
        (up.*inputs)[i] += h;
        (down.*inputs)[i] -= h;
        const double slope = (independent_total(up, 0.2, config) - independent_total(down, 0.2, config)) / (2 * h);
        EXPECT_NEAR(gradient[i], slope, 1e-8) << i;  // rounding 1e-16 / h, curvature h^2; no kink lies within h of these rows
      }
    };
    check(&Rows::log_prob, result.by_log_prob);
    check(&Rows::values, result.by_value);
    check(&Rows::entropy, result.by_entropy);
  }
}

TEST(PpoLoss, LogRatioIsClampedBeforeItOverflows) {
  for (const double advantage : {-1.0, 0.0, 1.0}) {
    torch::Tensor log_prob = torch::zeros({1}).requires_grad_(true);  // float32: exp(100) would be infinite
    const PpoLoss loss = ppo_loss(log_prob, torch::full({1}, -100.0), torch::full({1}, advantage), torch::zeros({1}), torch::zeros({1}),
                                  torch::zeros({1}), torch::zeros({1}), torch::ones({1}), 0.2, policy_only());
    const double expected = advantage < 0 ? std::exp(20.0) : -1.2 * advantage;
    EXPECT_NEAR(loss.total.item<double>(), expected, 1e-6 * std::exp(20.0) * (advantage < 0 ? 1 : 1e-8));
    EXPECT_NEAR(loss.approx_kl.item<double>(), std::exp(20.0) - 21, 100);
    loss.total.backward();
    EXPECT_TRUE(torch::isfinite(log_prob.grad()).all().item<bool>());
  }
}

TEST(PpoLoss, RowsThatDoNotCountMayHoldAnything) {
  const double nan = std::numeric_limits<double>::quiet_NaN();
  PpoConfig config;
  const Rows clean{{-1.1}, {-1}, {2}, {0.5}, {0.4}, {1}, {0.9}, {1}};
  Rows dirty = clean;
  for (Row* row :
       {&dirty.log_prob, &dirty.old_log_prob, &dirty.advantages, &dirty.values, &dirty.old_values, &dirty.returns, &dirty.entropy})
    row->push_back(nan);
  dirty.valid.push_back(0);
  const Result expected = evaluate(clean, 0.2, config), actual = evaluate(dirty, 0.2, config);
  EXPECT_EQ(actual.total, expected.total);
  EXPECT_EQ(actual.approx_kl, expected.approx_kl);
  EXPECT_EQ(actual.by_log_prob, (Row{expected.by_log_prob[0], 0}));
  EXPECT_EQ(actual.by_value, (Row{expected.by_value[0], 0}));
  EXPECT_EQ(actual.by_entropy, (Row{expected.by_entropy[0], 0}));

  dirty.valid = {0, 0};
  const Result without_rows = evaluate(dirty, 0.2, config);
  for (const double zero : {without_rows.total, without_rows.policy, without_rows.value, without_rows.entropy, without_rows.approx_kl,
                            without_rows.clip_fraction})
    EXPECT_EQ(zero, 0);
  EXPECT_EQ(without_rows.by_log_prob, (Row{0, 0}));
  EXPECT_EQ(without_rows.by_value, (Row{0, 0}));
}

TEST(PpoConfig, ReadsItsKeysAndRefusesNonsense) {
  ConfigReader reader = ConfigReader::from_text(
      "{clip: 0.1, value_coefficient: 0.4, entropy_coefficient: 0.2, learning_rate: 1e-3, adam_epsilon: 1e-6, max_gradient_norm: 0.5, "
      "epochs: 4, "
      "minibatches: 3, clip_value_loss: false, normalize_advantages: true, linear_learning_rate_decay: true, linear_clip_decay: true, "
      "gamma: 0.9, "
      "lambda: 0.8}",
      "test");
  PpoConfig config;
  read(reader, config);
  reader.finish();
  EXPECT_NO_THROW(validate(config));
  EXPECT_EQ(config.clip, 0.1);
  EXPECT_EQ(config.value_coefficient, 0.4);
  EXPECT_EQ(config.entropy_coefficient, 0.2);
  EXPECT_EQ(config.learning_rate, 1e-3);
  EXPECT_EQ(config.adam_epsilon, 1e-6);
  EXPECT_EQ(config.max_gradient_norm, 0.5);
  EXPECT_EQ(config.epochs, 4);
  EXPECT_EQ(config.minibatches, 3);
  EXPECT_FALSE(config.clip_value_loss);
  EXPECT_TRUE(config.normalize_advantages && config.linear_learning_rate_decay && config.linear_clip_decay);
  EXPECT_EQ(config.gae.gamma, 0.9);
  EXPECT_EQ(config.gae.lambda, 0.8);

  const auto refused = [](auto change) {
    PpoConfig bad;
    change(bad);
    EXPECT_THROW(validate(bad), InputError);
  };
  refused([](PpoConfig& c) { c.clip = 0; });
  refused([](PpoConfig& c) { c.clip = 1; });
  refused([](PpoConfig& c) { c.learning_rate = -1e-4; });
  refused([](PpoConfig& c) { c.learning_rate = std::numeric_limits<double>::quiet_NaN(); });
  refused([](PpoConfig& c) { c.adam_epsilon = 0; });
  refused([](PpoConfig& c) { c.max_gradient_norm = 0; });
  refused([](PpoConfig& c) { c.entropy_coefficient = -0.1; });
  refused([](PpoConfig& c) { c.value_coefficient = -0.1; });
  refused([](PpoConfig& c) { c.epochs = 0; });
  refused([](PpoConfig& c) { c.minibatches = 0; });
  refused([](PpoConfig& c) { c.gae.gamma = 1.01; });
  refused([](PpoConfig& c) { c.gae.lambda = -0.1; });
}

}  // namespace
}  // namespace earshot
