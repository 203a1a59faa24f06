// SPDX-License-Identifier: Apache-2.0
#include "trainer/run/toolchain.h"

#include <gnu/libc-version.h>

#include <cstddef>
#include <iterator>

#include "sim/base/compiler.h"
#include "sim/base/processor.h"
#include "sim/rays/ray_tracer_version.h"

namespace earshot {
namespace {

/// Processor that this file is compiled for, with further extensions behind a "+".
std::string compiled_for() {
  unsigned extensions = kUsedInstructionSets;
  std::string name = *kFirstProcessor == 0 ? "another processor" : kFirstProcessor;
  if (kDefaultInstructionSets != 0 && (extensions & kDefaultInstructionSets) == kDefaultInstructionSets) {
    name += "-v3";  // only x86-64 has a default beyond its first processor
    extensions &= ~kDefaultInstructionSets;
  }
  for (std::size_t set = 0; set < std::size(kInstructionSets); ++set)
    if ((extensions >> set & 1u) != 0) name += std::string("+") + kInstructionSets[set];
  return name;
}

}  // namespace

Toolchain simulation_toolchain() {
  return {{"compiler", compiler_name()},
          {"c_library", std::string("glibc ") + ::gnu_get_libc_version()},
          {"processor", compiled_for()},
          {"embree", ray_tracer_version() + " " + ray_tracer_isa()}};
}

std::string walking_toolchain(const Toolchain& toolchain) {
  std::string line;
  for (const char* name : {"compiler", "c_library", "processor", "embree"}) {
    const auto part = toolchain.find(name);
    if (part == toolchain.end()) continue;
    if (!line.empty()) line += ", ";
    line += (part->first == "embree" ? "Embree " : "") + part->second;
  }
  return line;
}

}  // namespace earshot
