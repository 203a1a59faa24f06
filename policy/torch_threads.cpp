// SPDX-License-Identifier: Apache-2.0
#include "policy/torch_threads.h"

#include <dlfcn.h>
#include <malloc.h>
#include <torch/utils.h>

#include <limits>

#include "sim/base/denormals.h"

namespace earshot {

void use_one_torch_thread() {
  torch::set_num_threads(1);
  // BLAS is chosen by Debian's alternatives at run time, so its symbol cannot be linked against; other BLAS libraries do not have it.
  if (void* symbol = dlsym(RTLD_DEFAULT, "openblas_set_num_threads")) reinterpret_cast<void (*)(int)>(symbol)(1);
  flush_denormals_on_this_thread();
  mallopt(M_MMAP_THRESHOLD, std::numeric_limits<int>::max());
  mallopt(M_TRIM_THRESHOLD, std::numeric_limits<int>::max());
}

}  // namespace earshot
