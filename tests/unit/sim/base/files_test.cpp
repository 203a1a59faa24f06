// SPDX-License-Identifier: Apache-2.0
#include "sim/base/files.h"

#include <gtest/gtest.h>
#include <sys/resource.h>

#include <csignal>
#include <filesystem>

#include "sim/base/errors.h"

namespace earshot {
namespace {

class Files : public testing::Test {
 protected:
  void SetUp() override {
    folder_ = std::filesystem::temp_directory_path() /
              ("earshot_files_" + std::string(testing::UnitTest::GetInstance()->current_test_info()->name()) + std::to_string(::getpid()));
    std::filesystem::create_directories(folder_);
  }
  void TearDown() override { std::filesystem::remove_all(folder_); }
  [[nodiscard]] std::size_t count() const {
    return static_cast<std::size_t>(std::distance(std::filesystem::directory_iterator(folder_), std::filesystem::directory_iterator()));
  }
  std::filesystem::path folder_;
};

TEST_F(Files, WrittenBytesComeBack) {
  const std::string bytes("a\0b\nc", 5);
  write_file_atomically(folder_ / "deep" / "file.bin", bytes);
  EXPECT_EQ(read_file(folder_ / "deep" / "file.bin"), bytes);
}

TEST_F(Files, MissingFileAndFolderAreInputErrors) {
  EXPECT_THROW(read_file(folder_ / "none"), InputError);
  EXPECT_THROW(read_file(folder_), InputError);
}

TEST_F(Files, OversizedFileIsRefused) {
  write_file_atomically(folder_ / "big", std::string(100, 'x'));
  EXPECT_THROW(read_file(folder_ / "big", 99), InputError);
  EXPECT_EQ(read_file(folder_ / "big", 100).size(), 100u);
}

// A disk that fills up mid-write, played by the process's file size limit: the old file stays whole and nothing else is left behind.
TEST_F(Files, FullDiskKeepsTheOldFile) {
  write_file_atomically(folder_ / "file", "old");
  std::signal(SIGXFSZ, SIG_IGN);
  rlimit before{};
  getrlimit(RLIMIT_FSIZE, &before);
  const rlimit small{4096, before.rlim_max};
  setrlimit(RLIMIT_FSIZE, &small);
  EXPECT_THROW(write_file_atomically(folder_ / "file", std::string(100000, 'n')), RunError);
  setrlimit(RLIMIT_FSIZE, &before);
  EXPECT_EQ(read_file(folder_ / "file"), "old");
  EXPECT_EQ(count(), 1u);
}

// XXH3 of the empty string with seed 0, from the algorithm's specification.
TEST(Hash, KnownAnswer) { EXPECT_EQ(hex64(hash64(std::string_view{})), "2d06800538d394c2"); }

}  // namespace
}  // namespace earshot
