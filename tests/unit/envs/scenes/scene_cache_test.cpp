// SPDX-License-Identifier: Apache-2.0
#include "envs/scenes/scene_cache.h"

#include <gtest/gtest.h>
#include <malloc.h>
#include <unistd.h>

#include <filesystem>
#include <fstream>
#include <memory>
#include <string>
#include <vector>

#include "sim/base/errors.h"
#include "tests/support/envs/scene_cache_cases.h"

namespace earshot {
namespace {

using namespace scene_cache_cases;

TEST(SceneCache, SourcesStandAboveTheGoal) {
  SceneCache cache(quick(), {}, "", kRoomy);
  const auto source = cache.source("shoebox:6x3x4", {2, 0, 1}, 1.2f);
  EXPECT_EQ(source->candidates.source(), glm::vec3(2, 1.2f, 1));
  EXPECT_NE(cache.source("shoebox:6x3x4", {2, 0, 1}, 1.3f), source);
  EXPECT_NE(cache.source("shoebox:6x3x4", {2, 0, 1.01f}, 1.2f), source);
  EXPECT_EQ(cache.source("shoebox:6x3x4", {2, 0, 1}, 1.2f), source);
  const auto distance_m = source->field.distance_m(*source->scene->navmesh.snap({5, 0, 1}));
  ASSERT_TRUE(distance_m);
  EXPECT_NEAR(*distance_m, 3.0f, 1e-3f);  // an empty room: a straight line
}

TEST(SceneCache, DropsTheLeastRecentlyUsedAndWhoHoldsItKeepsIt) {
  std::size_t scene_bytes = 0, with_source_bytes = 0;  // shoeboxes are all about as large
  {
    SceneCache cache(quick(), {}, "", kRoomy);
    cache.scene("shoebox:4x3x4");
    scene_bytes = cache.bytes();
    cache.source("shoebox:4x3x4", {2, 0, 2}, 1.5f);
    with_source_bytes = cache.bytes();
  }
  SceneCache cache(quick(), {}, "", with_source_bytes + scene_bytes + scene_bytes / 2);  // holds two
  auto a = cache.source("shoebox:4x3x4", {2, 0, 2}, 1.5f);
  cache.scene("shoebox:5x3x4");
  cache.scene("shoebox:4x3x4");  // used again: younger than the second
  cache.scene("shoebox:6x3x4");
  EXPECT_EQ(cache.num_scenes(), 2u);
  EXPECT_EQ(cache.scenes_loaded(), 3u);
  cache.scene("shoebox:4x3x4");
  EXPECT_EQ(cache.scenes_loaded(), 3u);  // still there
  cache.scene("shoebox:5x3x4");
  EXPECT_EQ(cache.scenes_loaded(), 4u);  // was dropped
  cache.scene("shoebox:7x3x4");
  cache.scene("shoebox:8x3x4");
  EXPECT_TRUE(a->field.distance_m(a->field.goal()));
  EXPECT_EQ(a->scene->scene->mesh().triangles.size(), 12u);

  // Held here, so evicting it would free nothing, and a second request would load it twice.
  EXPECT_EQ(cache.source("shoebox:4x3x4", {2, 0, 2}, 1.5f), a);
  EXPECT_GE(cache.held_bytes(), scene_bytes);
  a.reset();
  EXPECT_EQ(cache.held_bytes(), 0u);
  for (const char* room : {"shoebox:7.5x3x4", "shoebox:8.5x3x4", "shoebox:9.5x3x4", "shoebox:10.5x3x4"}) cache.scene(room);
  const std::uint64_t loaded = cache.scenes_loaded();
  cache.scene("shoebox:4x3x4");
  EXPECT_EQ(cache.scenes_loaded(), loaded + 1);  // no episode holds it any more: it went
}

// Episodes that hold more than the bound: all of it counts, all else goes, and what is held is served without a second load.
TEST(SceneCache, HeldScenesCountAgainstTheBound) {
  std::size_t one_bytes = 0;
  {
    SceneCache cache(quick(), {}, "", kRoomy);
    cache.scene("shoebox:4x3x4");
    one_bytes = cache.bytes();
  }
  SceneCache cache(quick(), {}, "", 3 * one_bytes);
  std::vector<std::shared_ptr<const EnvScene>> held;
  for (const char* room : {"shoebox:4x3x4", "shoebox:5x3x4", "shoebox:6x3x4", "shoebox:7x3x4", "shoebox:8x3x4"})
    held.push_back(cache.scene(room));
  std::size_t held_bytes = 0;
  for (const auto& scene : held) held_bytes += scene->bytes();
  EXPECT_EQ(cache.bytes(), held_bytes);
  EXPECT_EQ(cache.held_bytes(), held_bytes);
  EXPECT_GT(held_bytes, 4 * one_bytes);
  cache.scene("shoebox:9x3x4");
  cache.scene("shoebox:10x3x4");  // the one before had no use and no space
  EXPECT_EQ(cache.num_scenes(), 6u);
  EXPECT_EQ(cache.scene("shoebox:4x3x4"), held[0]);
  EXPECT_EQ(cache.scenes_loaded(), 7u);
  held.clear();
  cache.scene("shoebox:11x3x4");
  EXPECT_LE(cache.bytes(), 3 * one_bytes + one_bytes / 10);
}

// What is counted against what the allocator gave out.  Embree takes its memory from the system; mallinfo2 sees that as well, as mappings
// of its own arenas pass through malloc.
TEST(SceneCache, CountedBytesAreThoseOfTheAllocator) {
#ifdef EARSHOT_SANITIZED
  GTEST_SKIP() << "the sanitizer has an allocator of its own";
#endif
  SceneCache cache(quick(), {}, "", kRoomy);
  cache.scene("house:1,rooms=2,detail_m=0.3");  // what the process takes once: pools, devices
  const std::size_t counted_before = cache.bytes();
  const auto in_use = [] {
    const struct mallinfo2 info = ::mallinfo2();
    return info.uordblks + info.hblkhd;
  };
  const std::size_t before = in_use();
  for (int i = 2; i < 8; ++i) cache.scene("house:" + std::to_string(i) + ",rooms=4,detail_m=0.15");
  const double allocated = static_cast<double>(in_use() - before), counted = static_cast<double>(cache.bytes() - counted_before);
  EXPECT_GT(counted, 1e7);
  EXPECT_NEAR(counted / allocated, 1.0, 0.1);
}

TEST(SceneCache, ASceneLargerThanTheBoundIsStillServed) {
  SceneCache cache(quick(), {}, "", 0);
  EXPECT_TRUE(cache.scene("shoebox:4x3x4"));
  EXPECT_TRUE(cache.scene("shoebox:5x3x4"));
  EXPECT_EQ(cache.num_scenes(), 1u);
}

TEST(SceneCache, FailuresAreToldAndNotRemembered) {
  const auto folder = std::filesystem::temp_directory_path() / ("earshot_scenes_" + std::to_string(::getpid()));
  std::filesystem::create_directories(folder / "sub");
  SceneCache cache(quick(), {}, folder, kRoomy);
  EXPECT_THROW(cache.scene("sub/room.obj"), InputError);
  EXPECT_THROW(cache.source("sub/room.obj", {0, 0, 0}, 1.5f), InputError);
  // A floor and a lid: the path is relative to the root, and the file is there now.
  std::ofstream(folder / "sub" / "room.obj") << "v 0 0 0\nv 4 0 0\nv 4 0 4\nv 0 0 4\nv 0 3 0\nv 4 3 0\nv 4 3 4\nv 0 3 4\n"
                                                "f 1 3 2\nf 1 4 3\nf 5 6 7\nf 5 7 8\n";
  EXPECT_EQ(cache.scene("sub/room.obj")->scene->mesh().triangles.size(), 4u);
  EXPECT_THROW(cache.source("sub/room.obj", {100, 0, 0}, 1.5f), InputError);  // no floor there
  EXPECT_TRUE(cache.source("sub/room.obj", {2, 0, 2}, 1.5f));
  std::filesystem::remove_all(folder);
}

// A unit, an axis or the name of a scene stands behind the file, which is looked up under the root all the same.
TEST(SceneCache, KeysBehindAFileLeaveItUnderTheRoot) {
  const auto folder = std::filesystem::temp_directory_path() / ("earshot_scene_keys,1_" + std::to_string(getpid()));
  std::filesystem::create_directories(folder / "sub");
  for (const char* name : {"sub/room.obj", "set.scene_dataset_config.json"}) std::ofstream(folder / name) << "x";
  for (const std::string& inside :
       {std::string("sub/room.obj"), std::string("sub/room.obj,unit=0.01"), std::string("sub/room.obj,unit=0.01,up=z"),
        std::string("set.scene_dataset_config.json,scene=scenes/apt,1")})
    EXPECT_EQ(resolve_scene(inside, folder), (folder / inside).string());
  for (const std::string& other :
       {std::string("house:3,rooms=4"), std::string("sub/other.obj,unit=0.01"), (folder / "sub/room.obj,up=z").string()})
    EXPECT_EQ(resolve_scene(other, folder), other);
  std::filesystem::remove_all(folder);
}

}  // namespace
}  // namespace earshot
