// SPDX-License-Identifier: Apache-2.0
// version
// Which library this program runs with.
#include <earshot/version.h>

#include <cstdio>

int main() {
  const earshot::BuildInfo build = earshot::build_info();
  std::printf("earshot %s\ncommit %s, %s by %s, Embree %s with %s\n", earshot::version().c_str(), build.commit.c_str(),
              build.build_type.c_str(), earshot::compiler().c_str(), build.ray_tracer_version.c_str(), build.ray_tracer_isa.c_str());
}
