// SPDX-License-Identifier: Apache-2.0
// Signals have the same bytes for any number of threads, any split over machines, and after an interruption.

#include <gtest/gtest.h>

#include "datasets/convolve_corpus.h"
#include "tests/support/envs/convolve_corpus_cases.h"

namespace earshot {
namespace {

using corpus_cases::ConvolveFiles;
using corpus_cases::differences;
using corpus_cases::tree;

TEST(ConvolveCorpusThreads, ThreadsShardsAndInterruptionsChangeNoByte) {
  const ConvolveFiles files("convolve_threads");
  ConvolveConfig config = files.config();
  config.early = config.dry = config.stems = true;
  config.noise = files.path("noise").string();
  config.max_talkers = 2;
  const auto run = [&](const std::string& out, int threads, CorpusShard shard) {
    return write_convolve_corpus(config, {.out = files.path(out), .threads = threads, .shard = shard, .progress = {}});
  };
  run("one", 1, {});
  const auto expected = tree(files.path("one"));
  EXPECT_GT(expected.size(), 25u * 5);
  run("eight", 8, {});
  EXPECT_EQ(differences(tree(files.path("eight")), expected), std::vector<std::string>{});

  EXPECT_GT(run("split", 2, {2, 2}).folders_missing, 0u);
  EXPECT_FALSE(std::filesystem::exists(files.path("split/manifest.jsonl")));
  EXPECT_EQ(run("split", 2, {1, 2}).folders_missing, 0u);
  EXPECT_EQ(differences(tree(files.path("split")), expected), std::vector<std::string>{});

  // As a killed run leaves it: one folder without its manifest, a file half written.
  for (const char* name : {"00001/manifest.jsonl", "manifest.jsonl", "supervisions.jsonl"})
    std::filesystem::remove(files.path("eight") / name);
  write_file_atomically(files.path("eight/00001/0000012.wav"), "half");
  EXPECT_EQ(run("eight", 2, {}).signals, 10u);
  EXPECT_EQ(differences(tree(files.path("eight")), expected), std::vector<std::string>{});
}

}  // namespace
}  // namespace earshot
