// SPDX-License-Identifier: Apache-2.0
#include "bench/speed/scene_scale.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <algorithm>

#include "sim/base/errors.h"
#include "tests/support/files/test_files.h"

namespace earshot {
namespace {

TEST(SceneScale, AShortRunSeesLoadsStepsAndMemory) {
  const TempFolder folder;
  SceneScaleOptions options{.scenes = 3, .num_envs = 2, .threads = 1, .minutes = 0.05};
  options.store = folder / "store";
  const SceneScaleResult result = run_scene_scale(options);
  EXPECT_EQ(result.first_load_ms.size() + result.refused.size(), 3u);
  EXPECT_EQ(result.second_load_ms.size(), result.first_load_ms.size());
  EXPECT_GT(result.store_mb, 1);
  EXPECT_GT(result.steps, 0u);
  EXPECT_EQ(result.step_ms.size(), result.steps);
  ASSERT_EQ(result.step_cpu_ms.size(), result.steps);
  for (std::size_t i = 0; i < result.steps; ++i) {
    EXPECT_GT(result.step_cpu_ms[i], 0);
    EXPECT_LE(result.step_cpu_ms[i], result.step_ms[i] + 1);  // clocks of different steps
  }
  EXPECT_EQ(result.scenes_built, 0u);  // the first load of each has written them
  EXPECT_EQ(result.scenes_read, result.scenes_loaded);
  EXPECT_TRUE(std::ranges::is_sorted(result.slow, [](const SlowStep& a, const SlowStep& b) { return a.ms > b.ms; }));
  EXPECT_THAT(scene_scale_text(result), testing::HasSubstr("steps over 10 times the median"));
  EXPECT_EQ(scene_scale_report(result).json().at("bench"), "scenes");
}

TEST(SceneScale, RefusesWhatCannotBe) {
  EXPECT_THROW(run_scene_scale({}), InputError);  // no folder
  SceneScaleOptions options;
  options.store = "somewhere";
  options.scenes = 0;
  EXPECT_THROW(validate(options), InputError);
}

}  // namespace
}  // namespace earshot
