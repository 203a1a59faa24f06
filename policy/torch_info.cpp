// SPDX-License-Identifier: Apache-2.0
#include "policy/torch_info.h"

#include <torch/types.h>
#include <torch/utils.h>
#include <torch/version.h>

namespace earshot {

TorchInfo probe_torch() {
  torch::mm(torch::ones({2, 2}), torch::ones({2, 2}));
  return {TORCH_VERSION, torch::get_num_threads()};
}

}  // namespace earshot
