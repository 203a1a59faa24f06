// SPDX-License-Identifier: Apache-2.0
#include "datasets/corpus_folder.h"

#include <gtest/gtest.h>
#include <unistd.h>

#include <atomic>
#include <filesystem>
#include <string>
#include <thread>
#include <vector>

#include "sim/base/errors.h"
#include "sim/base/files.h"
#include "sim/base/process/part_file.h"

namespace earshot {
namespace {

class PartFiles : public testing::Test {
 protected:
  void SetUp() override { std::filesystem::create_directories(folder_); }
  void TearDown() override { std::filesystem::remove_all(folder_); }
  [[nodiscard]] std::size_t entries() const {
    std::size_t count = 0;
    for (const auto& entry : std::filesystem::recursive_directory_iterator(folder_)) count += entry.is_regular_file();
    return count;
  }

  std::filesystem::path folder_ = std::filesystem::temp_directory_path() / ("earshot_part_file_" + std::to_string(::getpid()));
};

// Two corpora of one scene, each with its own parts: both write the pictures of a point.
TEST_F(PartFiles, WritersOfOneFileDoNotMeet) {
  constexpr int writers = 4, rounds = 150;
  const std::size_t bytes = 100'000;
  std::atomic<int> failures = 0;
  std::vector<std::thread> threads;
  for (int writer = 0; writer < writers; ++writer)
    threads.emplace_back([&, writer] {
      const CorpusFolder corpus(folder_ / std::to_string(writer), 1, 1, 16000, 0, folder_);
      const std::string content(bytes + static_cast<std::size_t>(writer), static_cast<char>('a' + writer));
      for (int round = 0; round < rounds; ++round) {
        try {
          corpus.write_sound(0, "pictures/0.rgb.npy", content);
          const std::string found = read_file(folder_ / "pictures/0.rgb.npy");
          if (found.size() - bytes != static_cast<std::size_t>(found.front() - 'a') || found != std::string(found.size(), found.front()))
            ++failures;
        } catch (const std::exception&) {
          ++failures;
        }
      }
    });
  for (std::thread& thread : threads) thread.join();
  EXPECT_EQ(failures, 0);
  EXPECT_EQ(entries(), 1u);
}

TEST_F(PartFiles, WhatIsNotKeptIsNotThereAndWhatWasLeftIsReplaced) {
  const std::filesystem::path path = folder_ / "a/list.jsonl";
  {
    PartFile file(path);
    file.append("half");
  }
  EXPECT_EQ(entries(), 0u);
  write_file_atomically(path.string() + ".part", "left behind by a run that was killed");
  {
    PartFile file(path);
    file.append("one\n");
    file.append("two\n");
    EXPECT_FALSE(std::filesystem::exists(path));
    file.flush();
    file.keep();
  }
  EXPECT_EQ(read_file(path), "one\ntwo\n");
  EXPECT_EQ(entries(), 1u);
  EXPECT_THROW(PartFile(path / "below_a_file"), RunError);
}

}  // namespace
}  // namespace earshot
