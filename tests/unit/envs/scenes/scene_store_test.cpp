// SPDX-License-Identifier: Apache-2.0
#include "envs/scenes/scene_store.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <filesystem>
#include <fstream>
#include <string>
#include <vector>

#include "sim/base/errors.h"
#include "sim/base/files.h"
#include "sim/scene/scene_image.h"
#include "tests/support/envs/env_roll_out.h"
#include "tests/support/envs/field_env_fixture.h"
#include "tests/support/envs/scene_cache_cases.h"
#include "tests/support/files/test_files.h"

namespace earshot {
namespace {

using scene_cache_cases::quick;

class SceneStoreTest : public testing::Test {
 protected:
  SceneStore open(std::uint64_t max_bytes = 1 << 30) {
    return SceneStore({.folder = folder_ / "store", .max_bytes = max_bytes, .warn = [this](const std::string& message) {
                         warnings_.push_back(message);
                       }});
  }
  /// Paths of the files with this ending.
  [[nodiscard]] std::vector<std::filesystem::path> files(const std::string& ending) const {
    std::vector<std::filesystem::path> found;
    for (const auto& entry : std::filesystem::directory_iterator(folder_ / "store"))
      if (entry.path().extension() == ending) found.push_back(entry.path());
    return found;
  }
  TempFolder folder_;
  std::vector<std::string> warnings_;
};

constexpr const char* kHouse = "house:2,rooms=2,area_m2=30";

TEST_F(SceneStoreTest, TheSecondLoadReadsWhatTheFirstWrote) {
  SceneStore first = open(), second = open();
  const EnvScene built = first.load(kHouse, quick(), {}), read = second.load(kHouse, quick(), {});
  EXPECT_EQ(first.counters().built, 1u);
  EXPECT_EQ(first.counters().read, 0u);
  EXPECT_EQ(second.counters().built, 0u);
  EXPECT_EQ(second.counters().read, 1u);
  EXPECT_GT(second.counters().bytes_read, 10000u);
  EXPECT_EQ(read.scene->hash(), built.scene->hash());
  EXPECT_EQ(read.acoustics.hash(), built.acoustics.hash());
  EXPECT_EQ(encode_scene(*read.scene), encode_scene(*built.scene));
  EXPECT_TRUE(warnings_.empty());
}

// Sound, picture, rewards and walks of a batch: RIRs, depth and navmesh alike.
TEST_F(SceneStoreTest, WhereASceneComesFromChangesNoBit) {
  EnvConfig config = quick_env_config();
  const auto see = [](const EnvConfig& c, const std::shared_ptr<SceneCache>& scenes) {
    static const auto set = quick_set(1);
    BatchedEnv env(c, set, scenes, 3, 0, 4);
    env.reset();
    std::vector<float> seen;
    for (int i = 0; i < 20; ++i) {
      field_envs::step(env, 0, i);
      for (const auto rows : {float_rows(env, "heard"), float_rows(env, "spectrogram"), env.rewards(), float_rows(env, "depth"),
                              float_rows(env, "pointgoal")})
        seen.insert(seen.end(), rows.begin(), rows.end());
    }
    return seen;
  };
  const std::vector<float> reference = see(config, make_scene_cache(config));
  ASSERT_GT(reference.size(), 1000u);
  config.scene_store = folder_ / "store";
  const auto cold = make_scene_cache(config), warm = make_scene_cache(config);
  EXPECT_TRUE(see(config, cold) == reference);
  EXPECT_GT(cold->scene_store_counters().built, 0u);
  EXPECT_TRUE(see(config, warm) == reference);
  EXPECT_EQ(warm->scene_store_counters().built, 0u);
  EXPECT_EQ(warm->scene_store_counters().read, cold->scene_store_counters().built);
}

TEST_F(SceneStoreTest, OtherConfigsShareWhatTheyCan) {
  SceneStore store = open();
  store.load(kHouse, quick(), {});
  AcousticConfig acoustics = quick();
  acoustics.rir_length_s = 0.2f;
  store.load(kHouse, acoustics, {});
  EXPECT_EQ(files(".scene").size(), 1u);
  EXPECT_EQ(files(".acoustics").size(), 2u);
  EXPECT_EQ(files(".navmesh").size(), 1u);
  store.load(kHouse, acoustics, {.agent_radius_m = 0.2f});
  EXPECT_EQ(files(".acoustics").size(), 2u);
  EXPECT_EQ(files(".navmesh").size(), 2u);
  EXPECT_EQ(store.counters().built, 3u);
  acoustics.seed = 5;
  acoustics.threads = 2;
  const EnvScene other_seed = store.load(kHouse, acoustics, {.agent_radius_m = 0.2f});
  EXPECT_EQ(store.counters().built, 3u);
  EXPECT_EQ(other_seed.acoustics.config().seed, 5u);
  EXPECT_EQ(other_seed.acoustics.hash(), AcousticScene(other_seed.scene, acoustics).hash());
}

TEST_F(SceneStoreTest, DamagedFilesAreMadeAnewWithOneWarningEach) {
  const EnvScene built = open().load(kHouse, quick(), {});
  for (const char* ending : {".scene", ".acoustics", ".navmesh"}) {
    const auto path = files(ending).at(0);
    const std::string whole = read_file(path);
    std::string damaged = whole;
    damaged[damaged.size() / 2] = static_cast<char>(damaged[damaged.size() / 2] ^ 4);
    for (const std::string& bytes : {damaged, whole.substr(0, whole.size() / 2), std::string("no image"), std::string()}) {
      std::filesystem::remove(path);
      std::ofstream(path, std::ios::binary) << bytes;
      warnings_.clear();
      SceneStore store = open();
      const EnvScene anew = store.load(kHouse, quick(), {});
      EXPECT_EQ(warnings_.size(), 1u) << ending;
      EXPECT_EQ(store.counters().built, 1u);
      EXPECT_EQ(anew.acoustics.hash(), built.acoustics.hash());
      EXPECT_EQ(read_file(path), whole) << ending;  // written again
    }
  }
}

TEST_F(SceneStoreTest, AFileThatChangesIsAnotherScene) {
  const std::string obj = folder_.write("room.obj",
                                        "v 0 0 0\nv 4 0 0\nv 4 0 4\nv 0 0 4\nv 0 3 0\nv 4 3 0\nv 4 3 4\nv 0 3 4\n"
                                        "f 1 3 2\nf 1 4 3\nf 5 6 7\nf 5 7 8\n");
  const std::string yaml = folder_.write("scene.yaml", "mesh: room.obj\ndefault_material: lime_wash\n");
  SceneStore store = open();
  const std::uint64_t hash = store.load(yaml, quick(), {}).scene->hash();
  store.load(yaml, quick(), {});
  EXPECT_EQ(store.counters().built, 1u);
  folder_.write("scene.yaml", "mesh: room.obj\ndefault_material: gypsum_board\n");
  EXPECT_NE(store.load(yaml, quick(), {}).scene->hash(), hash);
  folder_.write("scene.yaml", "mesh: room.obj\ndefault_material: lime_wash\n");
  EXPECT_EQ(store.load(yaml, quick(), {}).scene->hash(), hash);
  EXPECT_EQ(store.counters().built, 2u);
}

TEST_F(SceneStoreTest, WhatCannotBeLoadedThrowsAsWithoutAStore) {
  SceneStore store = open();
  EXPECT_THROW(store.load("no_such.glb", quick(), {}), InputError);
  AcousticConfig wrong = quick();
  wrong.rays = -1;
  EXPECT_THROW(store.load(kHouse, wrong, {}), InputError);
  EXPECT_THROW(store.load("shoebox:0.2x0.2x0.2", quick(), {}), InputError);  // nothing to walk on
  SceneStore disabled_store({.folder = {}, .max_bytes = 0, .warn = {}});
  EXPECT_EQ(disabled_store.load(kHouse, quick(), {}).scene->name(), kHouse);
  EXPECT_EQ(disabled_store.counters().built, 1u);
}

TEST_F(SceneStoreTest, TheFolderKeepsToItsBound) {
  SceneStore store = open(200'000);
  for (int i = 1; i <= 6; ++i) store.load("house:" + std::to_string(i) + ",rooms=2,area_m2=30", quick(), {});
  std::uint64_t total = 0;
  for (const auto& entry : std::filesystem::directory_iterator(folder_ / "store")) total += entry.file_size();
  EXPECT_LE(total, 200'000u + 200'000u / 32);
  EXPECT_GT(total, 50'000u);
  EXPECT_TRUE(warnings_.empty());
}

}  // namespace
}  // namespace earshot
