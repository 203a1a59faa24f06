// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <torch/types.h>

#include "trainer/collective/collective.h"

namespace earshot {

/// (A - mean) / (std + 1e-7), mean and biased variance over the valid rows of all workers.  advantages [T, B] float64, valid [T, B] bool;
/// returns float64.  Two collective sums, whatever this worker holds.
///
/// Two passes, so that a large offset does not eat the variance: the mean square less the squared mean has lost all digits of a spread of 1
/// at an offset of 1e8.  Advantages that differ by no more than the rounding of the float32 rewards and values they came from become
/// exactly 0, and so does a single one: dividing by such a spread would make rounding the signal.  Rows that are not finite do not enter
/// mean and variance, or one worker's fault would be that of all; they stay what they are.
torch::Tensor normalize_advantages(const torch::Tensor& advantages, const torch::Tensor& valid, Collective& collective);

}  // namespace earshot
