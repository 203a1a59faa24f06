// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <map>
#include <string>

namespace earshot {

/// Parts of the toolchain that decide the bits of a program's results, by name: "compiler" ("g++12"), "c_library" ("glibc 2.36"),
/// "processor"
/// (compiled for: "x86-64-v3"), "embree" (version and instruction set: "3.13.5 avx2"), "libtorch" (version and instruction set), "onednn"
/// (instruction set), "blas" (version and kernels: "OpenBLAS 0.3.21 Haswell").
using Toolchain = std::map<std::string, std::string>;

/// Of this program on this machine, without "libtorch", "onednn" and "blas".  Throws InputError if Embree opens no device.
Toolchain simulation_toolchain();
/// All of it; for programs with libtorch, which it loads.  Throws as above.
Toolchain this_toolchain();

/// The parts that decide what walking an episode computes (poses, distances, metrics), which torch has no part in, in one line:
/// "g++12, glibc 2.36, x86-64-v3, Embree 3.13.5 avx2".  Two toolchains walk alike where the lines are equal.  Empty for no toolchain.
std::string walking_toolchain(const Toolchain& toolchain);

}  // namespace earshot
