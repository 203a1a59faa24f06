// SPDX-License-Identifier: Apache-2.0
// One corpus has the same bytes for any number of threads and any split over machines.

#include <gtest/gtest.h>

#include "datasets/rir_corpus.h"
#include "tests/support/envs/env_cases.h"
#include "tests/support/envs/rir_corpus_cases.h"

namespace earshot {
namespace {

using corpus_cases::differences;
using corpus_cases::tiny;
using corpus_cases::tree;

TEST(RirCorpusThreads, AnyNumberOfThreadsGivesTheSameBytes) {
  RirCorpusConfig config = tiny();
  config.split_ms = 30;
  const TestFolder reference("corpus_one_thread");
  write_rir_corpus(config, {.out = reference.path(), .threads = 1, .shard = {}, .progress = {}});
  const auto expected = tree(reference.path());
  EXPECT_EQ(expected.size(), 18u * 3 + 2 + 3);  // whole, early, late; manifests of two folders; corpus.json, manifest, recordings
  for (const int threads : {2, 8}) {            // of 8 more than there are rooms: they help with the sources of others
    const TestFolder folder("corpus_threads");
    write_rir_corpus(config, {.out = folder.path(), .threads = threads, .shard = {}, .progress = {}});
    EXPECT_EQ(differences(tree(folder.path()), expected), std::vector<std::string>{}) << threads << " threads";
  }
}

TEST(RirCorpusThreads, AnySplitGivesTheSameBytes) {
  const RirCorpusConfig config = tiny();
  const TestFolder reference("corpus_whole"), folder("corpus_split_up");
  write_rir_corpus(config, {.out = reference.path(), .threads = 2, .shard = {}, .progress = {}});
  const CorpusReport second = write_rir_corpus(config, {.out = folder.path(), .threads = 1, .shard = {2, 2}, .progress = {}});
  EXPECT_EQ(second.rooms, 1u);
  EXPECT_EQ(second.folders_missing, 1u);
  EXPECT_FALSE(std::filesystem::exists(folder.path() / "manifest.jsonl"));
  const CorpusReport first = write_rir_corpus(config, {.out = folder.path(), .threads = 2, .shard = {1, 2}, .progress = {}});
  EXPECT_EQ(first.rooms, 2u);
  EXPECT_EQ(first.folders_missing, 0u);
  EXPECT_EQ(differences(tree(folder.path()), tree(reference.path())), std::vector<std::string>{});
}

// What a run that was killed leaves: a room without its line, a file that is half written.
TEST(RirCorpusThreads, APartialFolderIsCompletedWithTheSameBytes) {
  const RirCorpusConfig config = tiny();
  const TestFolder reference("corpus_reference"), folder("corpus_partial");
  write_rir_corpus(config, {.out = reference.path(), .threads = 2, .shard = {}, .progress = {}});
  const auto expected = tree(reference.path());
  write_rir_corpus(config, {.out = folder.path(), .threads = 2, .shard = {}, .progress = {}});
  const std::filesystem::path first = folder.path() / "00000";
  const std::string lines = read_file(first / "manifest.jsonl");
  std::size_t half = 0;  // the six lines of room 0
  for (int line = 0; line < 6; ++line) half = lines.find('\n', half) + 1;
  write_file_atomically(first / "room_000000.jsonl", lines.substr(0, half));
  std::filesystem::remove(first / "manifest.jsonl");
  std::filesystem::remove(folder.path() / "manifest.jsonl");
  std::filesystem::remove(first / "000001_s01_l0002.wav");
  write_file_atomically(first / "000001_s00_l0001.wav.part", "half");
  const CorpusReport report = write_rir_corpus(config, {.out = folder.path(), .threads = 2, .shard = {}, .progress = {}});
  EXPECT_EQ(report.rooms, 1u);  // room 0 and the second folder are there
  EXPECT_EQ(differences(tree(folder.path()), expected), std::vector<std::string>{});
}

}  // namespace
}  // namespace earshot
