#include "envs/scene_cache.h"

#include <gtest/gtest.h>
#include <unistd.h>

#include <filesystem>
#include <fstream>

#include "sim/base/errors.h"
#include "tests/support/scene_cache_cases.h"

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
  // A shoebox has 12 triangles: its estimate is the fixed part of a scene, 1 MiB and a little.
  SceneCache cache(quick(), {}, "", std::size_t{5} << 19);  // holds two
  const auto a = cache.source("shoebox:4x3x4", {2, 0, 2}, 1.5f);
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
  EXPECT_TRUE(a->field.distance_m(a->field.goal()));  // dropped by the cache, held here
  EXPECT_EQ(a->scene->scene->mesh().triangles.size(), 12u);
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

}  // namespace
}  // namespace earshot
