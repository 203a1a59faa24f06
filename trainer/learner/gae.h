// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <torch/types.h>

#include "trainer/learner/gae_config.h"

namespace earshot {

/// Generalized advantage estimation (Schulman et al. 2016, eqs. 11 to 16) with truncation bootstrapped from the final observation.
/// rewards, values, terminated, truncated, final_values [T, B]; next_value [B] of the observation after the last row.
/// values[t] = V(s_t).  terminated: the episode ended in the task sense: no bootstrap.  truncated: out of time: bootstrap from
/// final_values[t] = V(final observation, hidden state after s_t).  Both: terminated wins.  Either ends the chain of lambda. Values that
/// are not used by these rules may be anything, NaN included.  An env that idles after a row must have ended its episode in that row.
/// valid [T, B], if given: a row with 0 is a transition that is not known (a quarantined step).  Its advantage is 0, the chain of lambda
/// ends before it, and the row before it still bootstraps from values[t]. Computed in float64, returned in the type of rewards, without
/// gradient.  Returns advantages [T, B]; returns are advantages + values.
torch::Tensor gae(const torch::Tensor& rewards, const torch::Tensor& values, const torch::Tensor& terminated,
                  const torch::Tensor& truncated, const torch::Tensor& final_values, const torch::Tensor& next_value,
                  const GaeConfig& config, const torch::Tensor& valid = {});

}  // namespace earshot
