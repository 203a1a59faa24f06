// SPDX-License-Identifier: Apache-2.0
#include "apps/training/blas_kernel.h"

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <cctype>
#include <string_view>

namespace earshot {
namespace {

/// Those of OpenBLAS's names for x86-64 whose kernels have no AVX2.
constexpr std::array<std::string_view, 22> kWithoutAvx2{"generic",     "unknown",   "katmai",     "coppermine", "northwood",    "prescott",
                                                        "banias",      "core2",     "penryn",     "dunnington", "nehalem",      "atom",
                                                        "sandybridge", "nano",      "athlon",     "opteron",    "opteron_sse3", "barcelona",
                                                        "bobcat",      "bulldozer", "piledriver", "steamroller"};

}  // namespace

std::optional<std::string> blas_kernel_remedy(const std::string& kernel, bool avx2) {
  std::string lower = kernel;
  for (char& c : lower) c = static_cast<char>(std::tolower(static_cast<unsigned char>(c)));
  if (!avx2 || std::find(kWithoutAvx2.begin(), kWithoutAvx2.end(), lower) == kWithoutAvx2.end()) return std::nullopt;
  return fmt::format("kernels for {} do not use the AVX2 of this CPU: set OPENBLAS_CORETYPE=Haswell", kernel);
}

}  // namespace earshot
