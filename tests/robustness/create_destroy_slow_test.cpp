// SPDX-License-Identifier: Apache-2.0
#include <gtest/gtest.h>

#include "sim/base/errors.h"
#include "tests/support/envs/env_cases.h"

namespace earshot {
namespace {

TEST(H52_CreateAndDestroy, AThousandScenesLeaveNothingBehind) {
  const AcousticConfig acoustics = quick_env_config().acoustics;
  const TestFolder folder("cycles");
  const std::string broken = (folder.path() / "broken.obj").string();
  write_text(broken, "v 0 0 0\nv 1 0 nan\nv 0 1 0\nf 1 2 3\n");
  double warm_mib = 0;
  for (int cycle = 0; cycle < 1000; ++cycle) {
    if (cycle == 200) warm_mib = resident_mib();
    SceneCache cache(acoustics, NavmeshConfig{}, "", std::size_t{1} << 30);
    if (cycle % 2 == 0) {
      ASSERT_THROW(cache.scene("no_such_scene.obj"), InputError);
      if (cycle % 100 == 0) {
        ASSERT_THROW(cache.scene(broken), InputError);  // read in a process of its own
      }
      ASSERT_THROW(cache.source("shoebox:4x3x3@0.5", {100, 0, 100}, 1.5f), InputError);  // after the scene, while its source is made
    } else {
      ASSERT_TRUE(cache.source("shoebox:4x3x3@0.5", {2, 0, 2}, 1.5f)->field.distance_m({1, 0, 1}));
    }
  }
  EXPECT_LT(resident_mib() - warm_mib, 8.0);  // 800 cycles; a lost ray structure would be 1 MiB each
}

}  // namespace
}  // namespace earshot
