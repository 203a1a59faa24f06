// SPDX-License-Identifier: Apache-2.0
#include "policy/conv_stack.h"

#include <gtest/gtest.h>
#include <torch/csrc/autograd/autograd.h>
#include <torch/nn/functional/conv.h>

#include <cmath>
#include <vector>

#include "policy/matrix_product.h"
#include "tests/support/largest.h"

namespace earshot {
namespace {

struct Stack {
  std::int64_t pictures, rows, columns, channels, out_channels;
  std::array<int, kStackLayers> kernels, strides;
};

/// The published network's camera and sound, a picture in colours, one that no copy of a fixed length fits, and fewest outputs.
const std::vector<Stack> kStacks{{6, 128, 128, 1, 32, {8, 4, 3}, {4, 2, 2}},
                                 {5, 65, 26, 2, 32, {5, 3, 3}, {2, 2, 1}},
                                 {9, 64, 64, 3, 16, {8, 4, 3}, {4, 2, 2}},
                                 {3, 41, 33, 5, 4, {3, 3, 2}, {2, 1, 1}},
                                 {1, 12, 12, 1, 2, {8, 4, 2}, {1, 1, 1}}};

struct Weights {
  std::array<torch::Tensor, kStackLayers> weights, biases;
  std::vector<torch::Tensor> leaves;
};

Weights random_weights(const Stack& stack) {
  Weights random;
  std::int64_t channels = stack.channels;
  for (std::size_t i = 0; i < kStackLayers; ++i) {
    const std::int64_t out = i == 0 ? stack.out_channels : 2 * stack.out_channels, kernel = stack.kernels[i];
    const double scale = std::sqrt(2.0 / static_cast<double>(channels * kernel * kernel));
    random.weights[i] = (torch::randn({out, channels, kernel, kernel}) * scale).requires_grad_(true);
    random.biases[i] = (torch::randn({out}) * 0.1).requires_grad_(true);
    random.leaves.insert(random.leaves.end(), {random.weights[i], random.biases[i]});
    channels = out;
  }
  return random;
}

torch::Tensor by_torch(const Stack& stack, const torch::Tensor& pictures, const Weights& w) {
  namespace F = torch::nn::functional;
  torch::Tensor x = pictures.permute({0, 3, 1, 2});
  for (std::size_t i = 0; i < kStackLayers; ++i) {
    x = F::conv2d(x, w.weights[i], F::Conv2dFuncOptions().bias(w.biases[i]).stride(stack.strides[i]));
    if (i + 1 < kStackLayers) x = x.relu();
  }
  return x.flatten(1);
}

TEST(ConvStack, EqualsTorchInValueAndInEveryGradient) {
  torch::manual_seed(1);
  for (const Stack& stack : kStacks) {
    const torch::Tensor pictures = torch::rand({stack.pictures, stack.rows, stack.columns, stack.channels});
    const Weights w = random_weights(stack);
    const torch::Tensor expected = by_torch(stack, pictures, w), actual = conv_stack(pictures, w.weights, w.biases, stack.strides);
    ASSERT_EQ(actual.sizes(), expected.sizes());
    // Sums of up to 576 products in float32 in two orders: 24 roundings in a row would be 3e-6 of the largest.
    EXPECT_LT(largest(actual - expected), 1e-5 * largest(expected));
    const torch::Tensor by_output = torch::randn(expected.sizes());
    const auto expected_gradients = torch::autograd::grad({(expected * by_output).sum()}, w.leaves);
    const auto actual_gradients = torch::autograd::grad({(actual * by_output).sum()}, w.leaves);
    for (std::size_t i = 0; i < w.leaves.size(); ++i) {
      EXPECT_GT(largest(expected_gradients[i]), 1e-3) << i;
      // Sums over pictures and positions: where an output is within rounding of 0, ReLU may cut on one side only.
      EXPECT_LT(largest(actual_gradients[i] - expected_gradients[i]), 1e-3 * largest(expected_gradients[i])) << "leaf " << i;
      EXPECT_LT((actual_gradients[i] - expected_gradients[i]).norm().item<double>(), 1e-4 * expected_gradients[i].norm().item<double>())
          << "leaf " << i;
    }
  }
}

TEST(ConvStack, TakesNoPicture) {
  const Weights w = random_weights(kStacks[1]);
  const torch::Tensor empty_batch = conv_stack(torch::zeros({0, 65, 26, 2}), w.weights, w.biases, kStacks[1].strides);
  EXPECT_EQ(empty_batch.size(0), 0);
  EXPECT_EQ(empty_batch.size(1), by_torch(kStacks[1], torch::zeros({1, 65, 26, 2}), w).size(1));
}

TEST(ConvStack, APictureDoesNotDependOnItsNeighbours) {
  torch::manual_seed(2);
  const Stack& stack = kStacks[1];
  const Weights w = random_weights(stack);
  const torch::Tensor pictures = torch::rand({7, stack.rows, stack.columns, stack.channels});
  const torch::Tensor all = conv_stack(pictures, w.weights, w.biases, stack.strides);
  for (const std::int64_t row : {0, 3, 6}) {
    torch::Tensor others = torch::rand(pictures.sizes());
    others[row].copy_(pictures[row]);
    EXPECT_TRUE(conv_stack(others, w.weights, w.biases, stack.strides)[row].equal(all[row])) << row;
  }
}

TEST(MatrixProduct, EqualsTorchInEveryOrientation) {
  torch::manual_seed(3);
  for (const torch::ScalarType type : {torch::kFloat32, torch::kFloat64})
    for (const bool transpose_a : {false, true})
      for (const bool transpose_b : {false, true})
        for (const float beta : {0.f, 1.f}) {
          const std::int64_t m = 5, n = 19, k = 33;
          const torch::Tensor a = torch::randn(transpose_a ? std::vector<std::int64_t>{k, m} : std::vector<std::int64_t>{m, k}, type);
          const torch::Tensor b = torch::randn(transpose_b ? std::vector<std::int64_t>{n, k} : std::vector<std::int64_t>{k, n}, type);
          torch::Tensor c = beta == 0 ? torch::full({m, n}, NAN, type) : torch::randn({m, n}, type);
          const torch::Tensor product = (transpose_a ? a.t() : a).mm(transpose_b ? b.t() : b);
          const torch::Tensor expected = beta == 0 ? product : product + c;
          multiply_into(c, a, transpose_a, b, transpose_b, beta);
          EXPECT_LT(largest(c - expected), type == torch::kFloat32 ? 1e-5 : 1e-13);
        }
}

TEST(LinearLayer, EqualsTorchInValueAndInEveryGradient) {
  torch::manual_seed(4);
  const std::vector<torch::Tensor> leaves{torch::randn({3, 4, 10}).requires_grad_(true), torch::randn({7, 10}).requires_grad_(true),
                                          torch::randn({7}).requires_grad_(true)};
  const torch::Tensor expected = torch::linear(leaves[0], leaves[1], leaves[2]), actual = linear_layer(leaves[0], leaves[1], leaves[2]);
  EXPECT_LT(largest(actual - expected), 1e-5);
  const torch::Tensor by_output = torch::randn(expected.sizes());
  const auto expected_gradients = torch::autograd::grad({(expected * by_output).sum()}, leaves);
  const auto actual_gradients = torch::autograd::grad({(actual * by_output).sum()}, leaves);
  for (std::size_t i = 0; i < leaves.size(); ++i) EXPECT_LT(largest(actual_gradients[i] - expected_gradients[i]), 1e-5) << i;
}

}  // namespace
}  // namespace earshot
