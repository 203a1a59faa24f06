// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <span>

namespace earshot {

struct AdamRates {
  double learning_rate = 1e-3, beta1 = 0.9, beta2 = 0.999, epsilon = 1e-8;
};

/// One step of Adam (Kingma and Ba 2015, algorithm 1; epsilon outside the root, as in torch) on `gradients` times `scale`, in one pass over
/// the memory where torch::optim::Adam takes about ten.  step: number of this step, from 1.  All spans of one size; moments are those of
/// torch::optim::AdamParamState.  No allocation.
void adam_step(const AdamRates& rates, std::int64_t step, double scale, std::span<const float> gradients, std::span<float> first_moments,
               std::span<float> second_moments, std::span<float> weights);

}  // namespace earshot
