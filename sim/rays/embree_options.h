// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <string>
#include <vector>

namespace earshot {

/// A vector instruction set by its name in Embree's `isa=`, and whether this processor has it.
struct RayIsa {
  std::string name;
  bool present = false;
};

/// sse2, sse4.2, avx, avx2, avx512, the widest last; empty on processors other than x86-64.
std::vector<RayIsa> ray_isas();

/// Options for a device of Embree.  isa: value of the environment variable EARSHOT_ISA.  Empty: the widest present up to AVX2; up
/// to there all results have the same bits (tests/pinned).  Throws InputError for a name that is not in `isas` (Embree would take
/// SSE2 without a word), and for one that the processor lacks.
std::string embree_options_of(const std::string& isa, const std::vector<RayIsa>& isas);

/// embree_options_of EARSHOT_ISA, which is read once: every device of a process has the same options.  No others: builds run on the
/// process's TBB pool, and "threads=1" would cap that pool for the whole process.
const std::string& embree_device_options();

}  // namespace earshot
