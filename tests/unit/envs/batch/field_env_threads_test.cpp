// SPDX-License-Identifier: Apache-2.0
#include <gtest/gtest.h>
#include <tbb/global_control.h>

#include "tests/support/envs/field_env_fixture.h"

namespace earshot {
namespace {

using namespace field_envs;

TEST_F(FieldEnv, ThreadsSplitsAndPrefetchChangeNoBit) {
  const tbb::global_control most(tbb::global_control::max_allowed_parallelism, 2);
  EnvConfig config = field_config();
  const Heard reference = roll_out(config, make_scene_cache(config), {4});
  config.threads = 2;
  EXPECT_TRUE(roll_out(config, make_scene_cache(config), {4}) == reference) << "2 threads";
  config.acoustics.threads = 2;
  EXPECT_TRUE(roll_out(config, make_scene_cache(config), {4}) == reference) << "2 threads inside a field";
  config.threads = config.acoustics.threads = 1;
  config.prefetch = true;
  EXPECT_TRUE(roll_out(config, make_scene_cache(config), {1, 3}) == reference) << "split 1 + 3, prefetching";
}

}  // namespace
}  // namespace earshot
