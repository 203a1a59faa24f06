// SPDX-License-Identifier: Apache-2.0
#include "policy/torch_info.h"
#include "policy/torch_kernels.h"
#include "trainer/run/toolchain.h"

namespace earshot {

Toolchain this_toolchain() {
  const TorchKernels kernels = torch_kernels();
  Toolchain toolchain = simulation_toolchain();
  toolchain["libtorch"] = probe_torch().version + " " + kernels.libtorch;
  toolchain["onednn"] = kernels.onednn.empty() ? "none" : kernels.onednn;
  toolchain["blas"] = kernels.blas.empty() ? "unknown" : kernels.blas_version + " " + kernels.blas;
  return toolchain;
}

}  // namespace earshot
