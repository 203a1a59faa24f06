// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <torch/nn/module.h>
#include <torch/nn/pimpl.h>
#include <torch/types.h>

namespace earshot {

/// Gated recurrent unit (Cho et al. 2014) in the form of torch::nn::GRU: gates in the order reset, update, new; the reset gate acts after
/// the recurrent product.  The state is set to zero inside the sequence wherever an episode begins.
///
///   r = sigmoid(Wir x + bir + Whr h + bhr)      n  = tanh(Win x + bin + r (Whn h + bhn))
///   z = sigmoid(Wiz x + biz + Whz h + bhz)      h' = (1 - z) n + z h          with h = not_done h_previous
///
/// The backward pass is written out: autograd over cells writes one weight gradient of 3 H x H per step and adds them up, here they are one
/// product over the whole sequence.
class MaskedGruImpl : public torch::nn::Module {
 public:
  MaskedGruImpl(int input_size, int hidden_size);

  /// inputs [T, B, input_size]; hidden [B, hidden_size] before the first step; not_done [T, B], 0 where a new episode begins, else 1.
  /// Returns the state after each step, [T, B, hidden_size].
  torch::Tensor forward(const torch::Tensor& inputs, const torch::Tensor& hidden, const torch::Tensor& not_done);

  torch::Tensor weight_ih;         ///< [3 H, input_size]
  torch::Tensor weight_hh;         ///< [3 H, H]
  torch::Tensor bias_ih, bias_hh;  ///< [3 H]
};
TORCH_MODULE(MaskedGru);

}  // namespace earshot
