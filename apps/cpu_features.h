#pragma once

#include <string>
#include <vector>

namespace earshot {

/// An extension of the instruction set, whether this program was compiled for it (-march), and whether this CPU has it.
struct CpuFeature {
  const char* name;
  bool compiled_for, present;
};

/// The extensions of x86-64 that loops over floats use; empty on other machines.  A program that starts at all has what it was compiled
/// for: where that is missing, it says so in one line before main and ends with exit code 1.
std::vector<CpuFeature> cpu_features();

}  // namespace earshot
