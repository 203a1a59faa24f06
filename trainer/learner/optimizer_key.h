// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <torch/torch.h>
#include <torch/version.h>

namespace earshot {

/// The key under which libtorch's optimizers keep the state of a parameter: the address of its implementation, as text up to libtorch 1.13,
/// as a pointer from 2.0 on.
inline auto optimizer_key(const torch::Tensor& parameter) {
#if TORCH_VERSION_MAJOR >= 2
  return static_cast<void*>(parameter.unsafeGetTensorImpl());
#else
  return c10::guts::to_string(parameter.unsafeGetTensorImpl());
#endif
}

}  // namespace earshot
