// SPDX-License-Identifier: Apache-2.0
#include "trainer/learner/adam_kernel.h"

#include <gtest/gtest.h>
#include <torch/optim/adam.h>
#include <torch/types.h>
#include <torch/utils.h>

#include <cmath>
#include <limits>
#include <vector>

namespace earshot {
namespace {

TEST(AdamKernel, StepsAsTorchDoes) {
  torch::manual_seed(1);
  const std::int64_t count = 1003;
  torch::Tensor parameter = torch::randn({count});
  std::vector<float> weights(parameter.data_ptr<float>(), parameter.data_ptr<float>() + count), first(weights.size()),
      second(weights.size());
  torch::optim::Adam adam({parameter}, torch::optim::AdamOptions(1e-2).eps(1e-5));
  for (int step = 1; step <= 20; ++step) {
    const torch::Tensor gradient = torch::randn({count});
    parameter.mutable_grad() = gradient * 0.25;
    adam.step();
    adam_step({.learning_rate = 1e-2, .epsilon = 1e-5}, step, 0.25, {gradient.data_ptr<float>(), weights.size()}, first, second, weights);
  }
  double error = 0, moved = 0;
  for (std::size_t i = 0; i < weights.size(); ++i)
    error = std::max(error, std::abs(static_cast<double>(weights[i]) - static_cast<double>(parameter.data_ptr<float>()[i])));
  for (const float moment : first) moved = std::max(moved, std::abs(static_cast<double>(moment)));
  EXPECT_GT(moved, 1e-2);
  EXPECT_LT(error, 1e-5);  // twenty steps of at most 1e-2, each to about 1e-6 of itself, on weights of up to 4
}

TEST(AdamKernel, ScalesGradientsThatFloatsCannotSquare) {
  std::vector<float> gradient{1e30f, -1e30f}, first(2), second(2), weights(2);
  adam_step({.learning_rate = 0.1, .epsilon = 1e-5}, 1, 1e-31, gradient, first, second, weights);
  EXPECT_NEAR(weights[0], -0.1f, 1e-4f);  // lr g / (|g| + eps), g = 0.1
  EXPECT_NEAR(weights[1], 0.1f, 1e-4f);
}

}  // namespace
}  // namespace earshot
