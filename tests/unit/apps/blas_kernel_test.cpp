// SPDX-License-Identifier: Apache-2.0
#include "apps/training/blas_kernel.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <string>

namespace earshot {
namespace {

using testing::HasSubstr;

TEST(BlasKernel, IsAtFaultWhereItLeavesAvx2Unused) {
  struct Case {
    const char* kernel;
    bool has_avx2;
  };
  // Names as openblas_get_corename has them.
  for (const Case& c : {Case{"Prescott", false},
                        {"Core2", false},
                        {"Nehalem", false},
                        {"Barcelona", false},
                        {"Sandybridge", false},
                        {"Piledriver", false},
                        {"generic", false},
                        {"Unknown", false},
                        {"Haswell", true},
                        {"Zen", true},
                        {"Excavator", true},
                        {"SkylakeX", true},
                        {"Cooperlake", true},
                        {"SapphireRapids", true},
                        {"neoversen1", true},
                        {"", true}}) {
    EXPECT_EQ(blas_kernel_remedy(c.kernel, true).has_value(), !c.has_avx2) << c.kernel;
    EXPECT_FALSE(blas_kernel_remedy(c.kernel, false)) << c.kernel << " is all that a processor without AVX2 can run";
  }
  EXPECT_THAT(*blas_kernel_remedy("Prescott", true), HasSubstr("OPENBLAS_CORETYPE=Haswell"));
  EXPECT_THAT(*blas_kernel_remedy("Prescott", true), HasSubstr("Prescott"));
}

}  // namespace
}  // namespace earshot
