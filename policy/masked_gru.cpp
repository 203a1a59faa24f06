// SPDX-License-Identifier: Apache-2.0
#include "policy/masked_gru.h"

#include <torch/csrc/autograd/custom_function.h>

#include "policy/matrix_product.h"
#include "sim/base/errors.h"

namespace earshot {
namespace {

using torch::autograd::AutogradContext;
using torch::autograd::variable_list;

/// The recurrence alone.  from_input = W_i x + b_i is a plain linear layer over all steps and stays outside.
class Recurrence : public torch::autograd::Function<Recurrence> {
 public:
  static torch::Tensor forward(AutogradContext* context, const torch::Tensor& from_input, const torch::Tensor& hidden,
                               const torch::Tensor& not_done, const torch::Tensor& weight, const torch::Tensor& bias) {
    const std::int64_t T = from_input.size(0), B = from_input.size(1), H = hidden.size(1);
    // [H, 3H] in memory: products of few rows are up to a third faster on it, which pays for the copy after some steps.
    const bool transpose = T < 8;
    const torch::Tensor matrix = transpose ? weight.contiguous() : weight.t().contiguous();
    const torch::Tensor mask = not_done.unsqueeze(2);  // [T, B, 1]

    torch::Tensor before = torch::empty({T, B, H}, from_input.options());         // masked state before each step
    torch::Tensor gates = torch::empty({T, B, 3 * H}, from_input.options());      // r, z, n after their nonlinearity
    torch::Tensor recurrent = torch::empty({T, B, 3 * H}, from_input.options());  // W_h h + b_h
    torch::Tensor after = torch::empty({T, B, H}, from_input.options());
    for (std::int64_t t = 0; t < T; ++t) {
      torch::Tensor state = before[t], product = recurrent[t], next = after[t];
      at::mul_out(state, t == 0 ? hidden : after[t - 1], mask[t]);
      product.copy_(bias);
      multiply_into(product, state, false, matrix, transpose, 1);
      torch::Tensor reset_update = gates[t].narrow(1, 0, 2 * H), candidate = gates[t].narrow(1, 2 * H, H);
      at::add_out(reset_update, from_input[t].narrow(1, 0, 2 * H), product.narrow(1, 0, 2 * H)).sigmoid_();
      at::mul_out(candidate, reset_update.narrow(1, 0, H), product.narrow(1, 2 * H, H)).add_(from_input[t].narrow(1, 2 * H, H)).tanh_();
      at::lerp_out(next, candidate, state, reset_update.narrow(1, H, H));  // n + z (h - n)
    }
    context->save_for_backward({before, gates, recurrent.narrow(2, 2 * H, H), mask, weight});
    return after;
  }

  static variable_list backward(AutogradContext* context, variable_list outputs) {
    const variable_list saved = context->get_saved_variables();
    const torch::Tensor &before = saved[0], &gates = saved[1], &recurrent_n = saved[2], &mask = saved[3];
    const torch::Tensor matrix = saved[4].contiguous();
    const std::int64_t T = before.size(0), B = before.size(1), H = before.size(2);
    const torch::Tensor r = gates.narrow(2, 0, H), z = gates.narrow(2, H, H), n = gates.narrow(2, 2 * H, H);

    // Local derivatives of all steps at once; with g = dL/dh' of a step:
    //   dL/da_n = g (1 - z)(1 - n^2),  dL/da_z = g (h - n) z (1 - z),  dL/da_r = dL/da_n (W_hn h + b_hn) r (1 - r)
    // where a is what goes into the nonlinearity; the recurrent product of n sees dL/da_n r.
    const torch::Tensor by_n = (1 - z) * (1 - n * n);
    const torch::Tensor by_z = (before - n) * z * (1 - z);
    const torch::Tensor by_r = by_n * recurrent_n * r * (1 - r);
    const torch::Tensor by_product = torch::cat({by_r, by_z, by_n * r}, 2);  // [T, B, 3H]

    torch::Tensor to_product = torch::empty_like(by_product);  // dL / d(W_h h + b_h)
    torch::Tensor g = torch::zeros({B, H}, before.options()), from_later = torch::zeros({B, H}, before.options());
    torch::Tensor state_gradients = torch::empty_like(before);  // g of every step, for the gradient of the inputs
    for (std::int64_t t = T - 1; t >= 0; --t) {
      g = state_gradients[t];
      at::add_out(g, outputs[0][t], from_later);
      torch::Tensor step = to_product[t];
      torch::Tensor thirds = step.view({B, 3, H});
      at::mul_out(thirds, by_product[t].view({B, 3, H}), g.unsqueeze(1));
      at::mul_out(from_later, g, z[t]);
      multiply_into(from_later, step, false, matrix, false, 1);
      from_later.mul_(mask[t]);
    }

    // The candidate's input gradient lacks the factor r that its recurrent product has.
    const torch::Tensor to_input = torch::cat({to_product.narrow(2, 0, 2 * H), by_n * state_gradients}, 2);
    const torch::Tensor rows = to_product.view({T * B, 3 * H});
    torch::Tensor by_weight = torch::empty_like(matrix);
    multiply_into(by_weight, rows, true, before.view({T * B, H}), false);
    return {to_input, from_later, torch::Tensor(), by_weight, rows.sum(0)};
  }
};

}  // namespace

MaskedGruImpl::MaskedGruImpl(int input_size, int hidden_size) {
  weight_ih = register_parameter("weight_ih", torch::zeros({3 * hidden_size, input_size}));
  weight_hh = register_parameter("weight_hh", torch::zeros({3 * hidden_size, hidden_size}));
  bias_ih = register_parameter("bias_ih", torch::zeros({3 * hidden_size}));
  bias_hh = register_parameter("bias_hh", torch::zeros({3 * hidden_size}));
}

torch::Tensor MaskedGruImpl::forward(const torch::Tensor& inputs, const torch::Tensor& hidden, const torch::Tensor& not_done) {
  EARSHOT_EXPECT(inputs.dim() == 3 && hidden.dim() == 2 && not_done.dim() == 2);
  EARSHOT_EXPECT(inputs.size(1) == hidden.size(0) && not_done.sizes() == inputs.sizes().slice(0, 2));
  return Recurrence::apply(linear_layer(inputs, weight_ih, bias_ih), hidden, not_done, weight_hh, bias_hh);
}

}  // namespace earshot
