// SPDX-License-Identifier: Apache-2.0
#include <gtest/gtest.h>

#include <algorithm>
#include <filesystem>
#include <vector>

#include "tests/support/envs/field_env_fixture.h"

// Environments that hear through source fields: where a field comes from must change no bit.

namespace earshot {
namespace {

using namespace field_envs;

TEST_F(FieldEnv, WhereAFieldComesFromChangesNoBit) {
  EnvConfig config = field_config();
  const auto memory = make_scene_cache(config);
  const Heard reference = roll_out(config, memory, {4});
  EXPECT_GT(memory->field_counters().built, 2u);
  EXPECT_EQ(memory->field_counters().loaded, 0u);

  config.field_store = folder_.string();
  const auto cold = make_scene_cache(config), warm = make_scene_cache(config);
  EXPECT_TRUE(roll_out(config, cold, {4}) == reference) << "store cold";
  EXPECT_EQ(cold->field_counters().built, memory->field_counters().built);
  EXPECT_TRUE(roll_out(config, warm, {4}) == reference) << "store warm";
  EXPECT_EQ(warm->field_counters().built, 0u);
  EXPECT_EQ(warm->field_counters().loaded, memory->field_counters().built);
  EXPECT_EQ(warm->field_counters().bytes, memory->field_counters().bytes);

  config.acoustics.field = Switch::off;
  const auto traced = make_scene_cache(config);
  EXPECT_FALSE(roll_out(config, traced, {4}) == reference);
  EXPECT_EQ(traced->field_counters().built, 0u);
}

TEST_F(FieldEnv, ARestoredBatchGoesOnWithTheSameBits) {
  EnvConfig config = field_config();
  config.task.max_steps = 30;
  const auto set = quick_set(1);
  const auto scenes = make_scene_cache(config);
  BatchedEnv original(config, set, scenes, 3, 1, 4);
  original.reset();
  for (int i = 0; i < 11; ++i) step(original, 1, i);
  EnvConfig later = config;  // resumed by another process, with a store
  later.field_store = folder_.string();
  BatchedEnv copy(later, set, make_scene_cache(later), 3, 1, 4);
  copy.restore(original.save_state());
  for (int i = 11; i < 22; ++i) {
    EXPECT_TRUE(std::ranges::equal(float_rows(original, "heard"), float_rows(copy, "heard"))) << i;
    EXPECT_TRUE(std::ranges::equal(float_rows(original, "spectrogram"), float_rows(copy, "spectrogram"))) << i;
    step(original, 1, i);
    step(copy, 1, i);
  }
}

TEST_F(FieldEnv, TheBoundOfTheCacheCountsFields) {
  const EnvConfig config = field_config();
  const std::string id = "shoebox:6x3x5@0.3";
  const std::size_t scene_bytes = [&] {
    SceneCache cache(config.acoustics, config.navmesh, "", std::size_t{1} << 30);
    cache.scene(id);
    return cache.bytes();
  }();
  const std::size_t field_bytes = [&] {
    SceneCache cache(config.acoustics, config.navmesh, "", std::size_t{1} << 30);
    const auto source = cache.source(id, {2, 0, 2}, 1.5f);
    EXPECT_TRUE(source->sound_field);
    const std::size_t image_bytes = source->sound_field->image().size(), bytes = cache.bytes() - scene_bytes;
    EXPECT_GT(bytes, image_bytes);  // its paths count too
    EXPECT_LT(bytes, image_bytes + (std::size_t{256} << 10));
    return bytes;
  }();
  // Holds two fields and a half.
  SceneCache cache(config.acoustics, config.navmesh, "", scene_bytes + 5 * field_bytes / 2);
  const auto source = [&](int i) { return cache.source(id, {2, 0, 2 + 0.1f * static_cast<float>(i)}, 1.5f); };
  const auto held = source(0);
  source(1);
  source(0);
  source(2);  // 1 was used longest ago
  EXPECT_LE(cache.bytes(), scene_bytes + 5 * field_bytes / 2);
  EXPECT_EQ(cache.sources_built(), 3u);
  EXPECT_EQ(source(0), held);
  EXPECT_EQ(cache.sources_built(), 3u);
  source(1);
  EXPECT_EQ(cache.sources_built(), 4u);
  EXPECT_EQ(cache.num_scenes(), 1u);  // the scene outlives its sources

  // A second scene takes the place of the field that was used longest ago, not of the scene with its other field.
  const std::size_t bound = 2 * scene_bytes + 3 * field_bytes / 2;
  SceneCache two(config.acoustics, config.navmesh, "", bound);
  two.source(id, {2, 0, 2}, 1.5f);
  two.source(id, {2, 0, 2.1f}, 1.5f);
  two.scene("shoebox:5x3x5@0.3");
  EXPECT_EQ(two.num_scenes(), 2u);
  EXPECT_LE(two.bytes(), bound);
  two.source(id, {2, 0, 2.1f}, 1.5f);
  EXPECT_EQ(two.sources_built(), 2u);
}

TEST_F(FieldEnv, AutomaticIsOffForEpisodesAreShort) {
  EnvConfig config = field_config();
  config.acoustics.field = Switch::automatic;
  EXPECT_FALSE(make_scene_cache(config)->source("house:2,rooms=2,area_m2=30", quick_set(1)->episodes[0].goal_position, 1.5f)->sound_field);
}

// A turn keeps the response, a step makes a new one; every new one is counted once.
TEST_F(FieldEnv, CountersSumOverAgents) {
  const EnvConfig config = field_config();
  BatchedEnv env(config, quick_set(1), make_scene_cache(config), 3, 0, 3);
  env.reset();
  EXPECT_EQ(env.counters().effects.poses, 3u);
  EXPECT_EQ(env.counters().cached_responses, 0u);
  env.step(std::vector<std::int32_t>{2, 2, 3});
  EXPECT_EQ(env.counters().effects.poses, 3u);
  EXPECT_EQ(env.counters().cached_responses, 3u);
  for (int i = 0; i < 4; ++i) env.step(std::vector<std::int32_t>{1, 3, 2});
  const EffectCounters counters = env.counters().effects;
  EXPECT_GT(counters.poses, 3u);
  EXPECT_LE(counters.poses, 7u);  // env 0 may have walked into something
  EXPECT_EQ(counters.poses + env.counters().cached_responses, 3u * 6u);
  EXPECT_EQ(counters.field_gathers, counters.poses);
  EXPECT_LE(counters.in_sight, counters.poses);
}

TEST_F(FieldEnv, WithoutLateSoundThereIsNoField) {
  EnvConfig config = field_config();
  config.acoustics.late = Switch::off;
  const auto scenes = make_scene_cache(config);
  EXPECT_FALSE(scenes->source("shoebox:6x3x5@0.3", {2, 0, 2}, 1.5f)->sound_field);
}

}  // namespace
}  // namespace earshot
