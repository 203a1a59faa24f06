// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <torch/types.h>
#include <torch/utils.h>

#include <cstdint>

namespace earshot {

/// Initial weights as a function of (seed, index) alone, `index` numbering the tensors of a network: torch's global generator is not
/// touched. In float64, rounded once.

/// Normal with standard deviation sqrt(2 / fan_in), which keeps the variance through ReLU layers (He et al. 2015, eq. 10).  fan_in:
/// elements per row.
void fill_kaiming_normal(torch::Tensor weight, std::uint64_t seed, std::uint32_t index);
/// gain x a matrix with orthonormal rows or columns, whichever are fewer (Saxe et al. 2014): Q of a normal matrix, signs such that R has a
/// positive diagonal, so that Q is uniform over orthogonal matrices (Mezzadri 2007).
void fill_orthogonal(torch::Tensor weight, double gain, std::uint64_t seed, std::uint32_t index);

}  // namespace earshot
