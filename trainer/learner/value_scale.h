// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <torch/types.h>
#include <torch/utils.h>

#include <cstdint>

#include "policy/policy_network.h"
#include "trainer/collective/collective.h"

namespace earshot {

/// Moves the critic's origin and unit toward mean and deviation of the returns [T, B] of all workers, over rows that are valid: a tenth of
/// the way in each update, all of it in the first.  The critic's values stay what they were (PopArt, van Hasselt et al. 2016, eqs. 2 to 4).
/// A collective call: one sum of three numbers.
void follow_returns(const PolicyNetwork& policy, const torch::Tensor& returns, const torch::Tensor& valid, std::uint64_t update,
                    Collective& collective);

}  // namespace earshot
