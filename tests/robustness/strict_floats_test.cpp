// SPDX-License-Identifier: Apache-2.0
#include "sim/base/strict_floats.h"

#include <gtest/gtest.h>

#include <cmath>
#include <cstdlib>
#include <limits>
#include <string>

#include "tests/support/files/test_paths.h"

namespace earshot {
namespace {

/// 0 if the header compiles with these flags; -1 without a compiler.
int exit_code_with(const std::string& flags) {
  const char* compiler = std::getenv("CXX");
  const std::string program = compiler != nullptr && *compiler != 0 ? compiler : "c++";
  if (std::system(("command -v " + program + " >/dev/null 2>&1").c_str()) != 0) return -1;
  const std::string command = "echo '#include \"sim/base/strict_floats.h\"' | " + program + " -std=c++20 -O2 " + flags + " -I'" +
                              source_dir().string() + "' -fsyntax-only -x c++ - >/dev/null 2>&1";
  return std::system(command.c_str());
}

TEST(H71_FastMath, IsRefusedByTheCompiler) {
  const int plain = exit_code_with("");
  if (plain == -1) GTEST_SKIP() << "no compiler";
  EXPECT_EQ(plain, 0);
  EXPECT_EQ(exit_code_with("-ffp-contract=off -fno-math-errno"), 0);
  for (const char* flags :
       {"-ffast-math", "-Ofast", "-ffinite-math-only", "-fno-math-errno -ffinite-math-only", "-funsafe-math-optimizations"})
    EXPECT_NE(exit_code_with(flags), 0) << flags;
}

TEST(H71_FastMath, NotANumberIsSeenInThisBuild) {
  volatile double zero = 0, huge = std::numeric_limits<double>::max();
  EXPECT_FALSE(std::isfinite(zero / zero));
  EXPECT_FALSE(std::isfinite(huge * 2));
  EXPECT_TRUE(std::isnan(zero / zero));
  volatile double big = 1e16, one = 1;
  EXPECT_EQ((big + one) - big, 0.0);  // sums are not reordered
}

}  // namespace
}  // namespace earshot
