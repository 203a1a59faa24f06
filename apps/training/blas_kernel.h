// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <optional>
#include <string>

namespace earshot {

/// Advice if the kernels of `kernel` leave the processor's AVX2 unused; otherwise empty.  OpenBLAS takes them for a
/// processor that is newer than itself (0.3.21 of Debian 12 knows none after 2022), or by OPENBLAS_CORETYPE.  Kernels with AVX2 are no
/// fault on a processor with AVX-512: OpenBLAS has no others for AMD's. avx2: whether the processor has AVX2 and FMA.
std::optional<std::string> blas_kernel_remedy(const std::string& kernel, bool avx2);

}  // namespace earshot
