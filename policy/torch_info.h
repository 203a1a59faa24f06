// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <string>

namespace earshot {

struct TorchInfo {
  std::string version;  ///< of the libtorch that this program was built with
  int threads = 0;      ///< that operations of this process use
};
/// Multiplies two small matrices, which loads the BLAS behind libtorch, and reports.
TorchInfo probe_torch();

}  // namespace earshot
