// SPDX-License-Identifier: Apache-2.0
#include "earshot/version.h"

#include "sim/base/compiler.h"
#include "sim/base/engine_commit.h"
#include "sim/base/version.h"
#include "sim/rays/ray_tracer_version.h"

namespace earshot::api {

std::string version() { return kVersion; }
std::string compiler() { return compiler_name(); }

BuildInfo build_info() { return {engine_commit(), earshot::build_type(), ray_tracer_version(), ray_tracer_isa()}; }

}  // namespace earshot::api
