// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <torch/types.h>
#include <torch/utils.h>

#include <cstdint>

namespace earshot {

/// Row-major matrices in float32: c [m, n] = op(a) op(b) + beta c, where op transposes if asked.  lda, ldb, ldc: elements from one row to
/// the next, of a and b as they lie in memory.  With beta 0 what c holds is not read.
///
/// By oneDNN where libtorch brings it as a shared library: its kernels are made for the processor at run time, and know AVX-512 on
/// processors that OpenBLAS 0.3.21 takes for a Haswell (twice as fast there, docs/explanation/agent.md).  Else by the BLAS.  On one thread,
/// the bits are a function of the arguments and the processor.
struct MatrixProduct {
  std::int64_t m, n, k;
  bool transpose_a = false, transpose_b = false;
  float beta = 0;
};
void multiply(const MatrixProduct& product, const float* a, std::int64_t lda, const float* b, std::int64_t ldb, float* c, std::int64_t ldc);

/// c = op(a) op(b) + beta c for contiguous matrices of any floating type, float32 by the above.
void multiply_into(torch::Tensor& c, const torch::Tensor& a, bool transpose_a, const torch::Tensor& b, bool transpose_b, float beta = 0);

/// x W^T + b with gradients, as torch::linear.  x [..., in], weight [out, in], bias [out] -> [..., out].
torch::Tensor linear_layer(const torch::Tensor& x, const torch::Tensor& weight, const torch::Tensor& bias);

}  // namespace earshot
