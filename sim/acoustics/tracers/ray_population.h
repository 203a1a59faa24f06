// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <span>

namespace earshot {

/// Fraction of energy at which rays that weigh equally much would be worth as many: (sum w)^2 / sum w^2, between 1 and the count of
/// non-zero weights (Kong, Liu and Wong 1994); 0 if all weights are zero.
double effective_sample_size(std::span<const double> weights);

/// Systematic resampling (Kitagawa 1996): how many copies of each ray go on, so that `target` rays of equal weight carry what the present
/// ones carry.  copies[i] is target * weights[i] / sum, rounded up or down such that its mean over `random` (uniform in [0, 1)) is
/// exactly that; a copy must then be scaled by sum / (target * weights[i]).  Any sum over rays keeps its expectation: rays with
/// little left are ended, rays with much are split (the population form of Russian roulette and splitting).
/// weights, copies: [n], weights >= 0 with a positive sum.  The copies add up to `target`.
void systematic_resample(std::span<const double> weights, int target, double random, std::span<int> copies);

}  // namespace earshot
