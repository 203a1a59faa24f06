// SPDX-License-Identifier: Apache-2.0
#include <gtest/gtest.h>
#include <unistd.h>

#include <chrono>
#include <cstdint>
#include <filesystem>
#include <memory>
#include <string>
#include <thread>
#include <vector>

#include "envs/scenes/scene_cache.h"
#include "sim/base/random.h"
#include "tests/support/envs/scene_cache_cases.h"
#include "tests/support/wait_until.h"

namespace earshot {
namespace {

using namespace scene_cache_cases;

TEST(SceneCache, LoadsOnceForManyThreads) {
  SceneCache cache(quick(), {}, "", kRoomy);
  std::vector<std::shared_ptr<const EnvScene>> scenes(8);
  std::vector<std::shared_ptr<const EnvSource>> sources(8);
  {
    std::vector<std::jthread> threads;
    for (std::size_t i = 0; i < scenes.size(); ++i)
      threads.emplace_back([&, i] {
        scenes[i] = cache.scene("house:5,rooms=2");
        sources[i] = cache.source("house:5,rooms=2", scenes[i]->navmesh.random_point(RandomStream(1, Purpose::test), 0), 1.5f);
      });
  }
  for (const auto& scene : scenes) EXPECT_EQ(scene, scenes[0]);
  for (const auto& source : sources) EXPECT_EQ(source, sources[0]);
  EXPECT_EQ(cache.scenes_loaded(), 1u);
  EXPECT_EQ(cache.sources_built(), 1u);
}

TEST(SceneCache, PrefetchLoadsInTheBackground) {
  SceneCache cache(quick(), {}, "", kRoomy);
  cache.prefetch("no_such_file.glb", {0, 0, 0}, 1.5f);  // must not end the thread
  cache.prefetch("shoebox:6x3x4", {2, 0, 1}, 1.2f);
  EXPECT_TRUE(wait_until([&] { return cache.sources_built() > 0; }, 20));
  EXPECT_EQ(cache.sources_built(), 1u);
  cache.source("shoebox:6x3x4", {2, 0, 1}, 1.2f);
  EXPECT_EQ(cache.sources_built(), 1u);
}

// Caches of their own, as workers have: of each part one is made, and the others wait for it.
TEST(SceneCache, ManyCachesOfOneFolderMakeASceneOnce) {
  const auto folder = std::filesystem::temp_directory_path() / ("earshot_many_caches_" + std::to_string(::getpid()));
  std::filesystem::remove_all(folder);
  std::vector<std::unique_ptr<SceneCache>> caches;
  for (int i = 0; i < 4; ++i)
    caches.push_back(std::make_unique<SceneCache>(quick(), NavmeshConfig{}, "", kRoomy, FieldStoreConfig{},
                                                  SceneStoreConfig{.folder = folder, .max_bytes = kRoomy, .warn = {}}));
  {
    std::vector<std::jthread> threads;
    for (const auto& cache : caches) threads.emplace_back([&cache] { cache->scene("house:5,rooms=2"); });
  }
  std::uint64_t built = 0;
  for (const auto& cache : caches) built += cache->scene_store_counters().built;
  // Each part is made once; a cache that made one of the three counts as one that built.
  EXPECT_GE(built, 1u);
  EXPECT_LE(built, 3u);
  std::filesystem::remove_all(folder);
}

TEST(SceneCache, GoesAwayWhilePrefetching) {
  SceneCache cache(quick(), {}, "", kRoomy);
  for (int i = 4; i < 40; ++i) cache.prefetch("shoebox:" + std::to_string(i) + "x3x4", {2, 0, 2}, 1.5f);
}

}  // namespace
}  // namespace earshot
