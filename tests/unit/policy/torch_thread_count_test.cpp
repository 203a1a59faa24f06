// SPDX-License-Identifier: Apache-2.0
#include <dlfcn.h>
#include <gtest/gtest.h>

#include "policy/torch_threads.h"

namespace earshot {
namespace {

TEST(TorchThreads, OneThreadInBlasAndNoDenormals) {
  use_one_torch_thread();
  if (void* symbol = dlsym(RTLD_DEFAULT, "openblas_get_num_threads")) {
    EXPECT_EQ(reinterpret_cast<int (*)()>(symbol)(), 1);
  }
  volatile float smallest_normal = 1.17549435e-38f;
  EXPECT_EQ(smallest_normal * 0.25f, 0.f);
}

}  // namespace
}  // namespace earshot
