// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <torch/types.h>
#include <torch/utils.h>

#include <array>
#include <cstdint>

namespace earshot {

inline constexpr std::size_t kStackLayers = 3;

/// Three convolutions without padding, ReLU after the first two: pictures [N, height, width, channels] -> [N, features], features in the
/// order [channel, row, column] of the last layer, as torch flattens them.  weights[i] [out, in, kernel, kernel], biases[i] [out];
/// strides[i].  float32.  Gradients reach weights and biases; pictures are data.
///
/// Patches are copied to rows of a matrix (im2col, Chellapilla et al. 2006) a few pictures at a time, so that they stay in the cache
/// between copy and product, forward and backward: for these few channels the products then run at the speed of large ones, where oneDNN's
/// convolutions spend their time on changes of layout.  Memory beside the results: outputs of the first two layers for the backward pass,
/// and a few pictures' patches.
torch::Tensor conv_stack(const torch::Tensor& pictures, const std::array<torch::Tensor, kStackLayers>& weights,
                         const std::array<torch::Tensor, kStackLayers>& biases, const std::array<int, kStackLayers>& strides);

}  // namespace earshot
