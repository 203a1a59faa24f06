// SPDX-License-Identifier: Apache-2.0
// Recordings of scenes have the same bytes for any number of threads, any split over machines, and after an interruption.

#include <gtest/gtest.h>

#include "tests/support/envs/env_cases.h"
#include "tests/support/envs/sound_scene_cases.h"

namespace earshot {
namespace {

using corpus_cases::differences;
using corpus_cases::tree;

TEST(SoundSceneCorpusThreads, ThreadsShardsAndInterruptionsChangeNoByte) {
  SoundSceneConfig config = corpus_cases::dry_scenes();
  config.rooms.shoeboxes.count = 4;
  config.rooms.rooms_per_folder = 2;
  config.recordings_per_room = 1;
  config.duration_s = 1;
  config.events = {1, 2};
  config.event_s = {0.3f, 0.6f};
  config.noise = "synth";
  config.rooms.channels = "binaural";
  const TestFolder folder("scene_threads");
  const auto run = [&](const std::string& out, int threads, CorpusShard shard) {
    return write_sound_scenes(config, {.out = folder.path() / out, .threads = threads, .shard = shard, .progress = {}});
  };
  run("one", 1, {});
  const auto expected = tree(folder.path() / "one");
  EXPECT_EQ(expected.size(), 4u * 2 + 2 + 5);  // sound and labels; manifests of two folders; five files of the whole
  EXPECT_EQ(run("four", 4, {}).recordings, 4u);
  EXPECT_EQ(differences(tree(folder.path() / "four"), expected), std::vector<std::string>{});

  EXPECT_EQ(run("split", 2, {2, 2}).folders_missing, 1u);
  EXPECT_EQ(run("split", 2, {1, 2}).folders_missing, 0u);
  EXPECT_EQ(differences(tree(folder.path() / "split"), expected), std::vector<std::string>{});

  // As a killed run leaves it: one folder without its manifest, files half written.
  for (const char* name : {"00001/manifest.jsonl", "manifest.jsonl", "supervisions.jsonl"})
    std::filesystem::remove(folder.path() / "four" / name);
  for (const char* name : {"00001/000002_r0000.wav", "00001/000003_r0000.csv"}) {
    ASSERT_TRUE(expected.contains(name));
    write_file_atomically(folder.path() / "four" / name, "half");
  }
  EXPECT_EQ(run("four", 2, {}).recordings, 2u);
  EXPECT_EQ(differences(tree(folder.path() / "four"), expected), std::vector<std::string>{});
}

}  // namespace
}  // namespace earshot
