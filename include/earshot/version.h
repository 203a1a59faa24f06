// SPDX-License-Identifier: Apache-2.0
#pragma once

/// @file
/// Version and build of the library.

#include <string>

#include "earshot/errors.h"

namespace earshot::api {

/// Version of the library that the program is linked with: "MAJOR.MINOR.PATCH".
std::string version();

/// Compiler that the library was built with: "g++12", "clang14".
std::string compiler();

/// How the library was built and what it runs on.
struct BuildInfo {
  std::string commit;              ///< of the sources, with "-dirty" if files differed; "unknown" outside a repository
  std::string build_type;          ///< "Release", "Debug"
  std::string ray_tracer_version;  ///< of Embree, "4.3.3"
  std::string ray_tracer_isa;      ///< instruction set that Embree uses in this process, "avx2"
};
/// @throws InputError if Embree opens no device.
BuildInfo build_info();

}  // namespace earshot::api
