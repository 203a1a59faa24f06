// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <torch/types.h>

namespace earshot {

/// The largest magnitude of an element.
inline double largest(const torch::Tensor& tensor) { return tensor.abs().max().item<double>(); }

}  // namespace earshot
