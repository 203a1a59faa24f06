// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <string>

namespace earshot {

/// Kernels that libtorch and the libraries behind it have chosen for this processor: they decide the bits and the speed of training.
struct TorchKernels {
  std::string libtorch;      ///< instruction set of libtorch's own loops: "AVX2", "NO AVX"
  std::string onednn;        ///< of oneDNN: "sse4.1", "avx", "avx2", "avx512", "other"; empty if it is not loaded
  std::string blas;          ///< processor whose kernels OpenBLAS uses: "Haswell", "Zen", "Prescott"; empty for another BLAS
  std::string blas_version;  ///< "OpenBLAS 0.3.21"; empty for another BLAS
};
TorchKernels torch_kernels();

}  // namespace earshot
