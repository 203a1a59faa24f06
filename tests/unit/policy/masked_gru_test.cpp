// SPDX-License-Identifier: Apache-2.0
#include "policy/masked_gru.h"

#include <gtest/gtest.h>
#include <torch/csrc/autograd/autograd.h>
#include <torch/nn/modules/rnn.h>

#include "tests/support/largest.h"

namespace earshot {
namespace {

using torch::kFloat64;

MaskedGru random_gru(int inputs, int hidden) {
  MaskedGru gru(inputs, hidden);
  gru->to(kFloat64);
  const torch::NoGradGuard no_gradient;
  for (torch::Tensor& parameter : gru->parameters()) parameter.copy_(torch::randn(parameter.sizes(), kFloat64) * 0.5);
  return gru;
}

/// The equations of the header, one cell after the other, differentiated by autograd.
torch::Tensor cell_by_cell(const MaskedGru& gru, const torch::Tensor& inputs, torch::Tensor state, const torch::Tensor& not_done) {
  std::vector<torch::Tensor> states;
  const std::int64_t H = state.size(1);
  for (std::int64_t t = 0; t < inputs.size(0); ++t) {
    state = state * not_done[t].unsqueeze(1);
    const torch::Tensor in = inputs[t].mm(gru->weight_ih.t()) + gru->bias_ih, rec = state.mm(gru->weight_hh.t()) + gru->bias_hh;
    const torch::Tensor r = torch::sigmoid(in.slice(1, 0, H) + rec.slice(1, 0, H));
    const torch::Tensor z = torch::sigmoid(in.slice(1, H, 2 * H) + rec.slice(1, H, 2 * H));
    const torch::Tensor n = torch::tanh(in.slice(1, 2 * H, 3 * H) + r * rec.slice(1, 2 * H, 3 * H));
    state = (1 - z) * n + z * state;
    states.push_back(state);
  }
  return torch::stack(states);
}

// Both are float64 and differ in the order of sums only: 1e-12 leaves a factor 100 of room.
constexpr double kTolerance = 1e-12;

TEST(MaskedGru, EqualsTheCellsInValueAndInEveryGradient) {
  torch::manual_seed(1);
  for (const std::int64_t T : {1, 3, 11}) {
    const std::int64_t B = 3, I = 5, H = 7;
    MaskedGru gru = random_gru(I, H);
    torch::Tensor inputs = torch::randn({T, B, I}, kFloat64).requires_grad_(true),
                  hidden = torch::randn({B, H}, kFloat64).requires_grad_(true);
    torch::Tensor not_done = (torch::rand({T, B}, kFloat64) > 0.3).to(kFloat64);
    not_done[0][0] = 1;  // a state that comes in and
    not_done[0][1] = 0;  // one that does not
    const torch::Tensor weights = torch::randn({T, B, H}, kFloat64);

    std::vector<torch::Tensor> leaves = gru->parameters();
    leaves.push_back(inputs);
    leaves.push_back(hidden);
    const torch::Tensor actual = gru->forward(inputs, hidden, not_done), expected = cell_by_cell(gru, inputs, hidden, not_done);
    EXPECT_LT(largest(actual - expected), kTolerance);
    const auto actual_gradients = torch::autograd::grad({(actual * weights).sum()}, leaves);
    const auto expected_gradients = torch::autograd::grad({(expected * weights).sum()}, leaves);
    for (std::size_t i = 0; i < leaves.size(); ++i) {
      EXPECT_GT(largest(expected_gradients[i]), 1e-3) << i;  // nothing passes because it is zero
      EXPECT_LT(largest(actual_gradients[i] - expected_gradients[i]), kTolerance * 10) << "leaf " << i << ", T = " << T;
    }
  }
}

TEST(MaskedGru, EqualsTorchWhereNoEpisodeBegins) {
  torch::manual_seed(2);
  const std::int64_t T = 6, B = 2, I = 4, H = 5;
  MaskedGru gru = random_gru(I, H);
  torch::nn::GRU torch_gru(torch::nn::GRUOptions(I, H));
  torch_gru->to(kFloat64);
  {
    const torch::NoGradGuard no_gradient;
    auto named = torch_gru->named_parameters();
    named["weight_ih_l0"].copy_(gru->weight_ih);
    named["weight_hh_l0"].copy_(gru->weight_hh);
    named["bias_ih_l0"].copy_(gru->bias_ih);
    named["bias_hh_l0"].copy_(gru->bias_hh);
  }
  const torch::Tensor inputs = torch::randn({T, B, I}, kFloat64), hidden = torch::randn({B, H}, kFloat64);
  const torch::Tensor expected = std::get<0>(torch_gru->forward(inputs, hidden.unsqueeze(0)));
  EXPECT_LT(largest(gru->forward(inputs, hidden, torch::ones({T, B}, kFloat64)) - expected), kTolerance);
}

TEST(MaskedGru, NothingCrossesTheBeginningOfAnEpisode) {
  torch::manual_seed(3);
  MaskedGru gru = random_gru(2, 4);
  torch::Tensor inputs = torch::randn({5, 1, 2}, kFloat64).requires_grad_(true);
  torch::Tensor not_done = torch::ones({5, 1}, kFloat64);
  not_done[3][0] = 0;
  gru->forward(inputs, torch::randn({1, 4}, kFloat64), not_done)[4].sum().backward();
  EXPECT_EQ(largest(inputs.grad().slice(0, 0, 3)), 0.0);
  EXPECT_GT(largest(inputs.grad()[3]), 0.0);
}

}  // namespace
}  // namespace earshot
