// SPDX-License-Identifier: Apache-2.0
#include "sim/base/file_lock.h"

#include <gtest/gtest.h>
#include <signal.h>
#include <sys/wait.h>
#include <unistd.h>

#include <filesystem>
#include <fstream>
#include <string>

#include "tests/support/wait_until.h"

namespace earshot {
namespace {

using std::chrono::milliseconds;

class FileLockTest : public testing::Test {
 protected:
  void SetUp() override { std::filesystem::create_directories(folder_); }
  void TearDown() override { std::filesystem::remove_all(folder_); }
  const std::filesystem::path folder_ =
      std::filesystem::temp_directory_path() /
      ("earshot_lock_" + std::string(testing::UnitTest::GetInstance()->current_test_info()->name()) + std::to_string(::getpid()));
  const std::filesystem::path path_ = folder_ / "a.lock";
};

TEST_F(FileLockTest, OneHolderAtATimeAndNoFileIsLeft) {
  {
    auto held = FileLock::acquire(path_, milliseconds(0));
    ASSERT_TRUE(held);
    EXPECT_FALSE(FileLock::acquire(path_, milliseconds(20)));
    EXPECT_TRUE(FileLock::acquire(folder_ / "b.lock", milliseconds(0)));
    const FileLock moved = std::move(*held);
    held.reset();
    EXPECT_FALSE(FileLock::acquire(path_, milliseconds(0)));
  }
  EXPECT_TRUE(std::filesystem::is_empty(folder_));
  EXPECT_TRUE(FileLock::acquire(path_, milliseconds(0)));
}

TEST_F(FileLockTest, AKilledHolderHoldsNothing) {
  const pid_t child = ::fork();
  ASSERT_GE(child, 0);
  if (child == 0) {
    const auto held = FileLock::acquire(path_, milliseconds(0));
    std::ofstream(folder_ / "held").put(held ? '1' : '0');
    ::pause();
    ::_exit(0);
  }
  ASSERT_TRUE(wait_until([&] { return std::filesystem::exists(folder_ / "held"); }, 60, {&child, 1}));
  EXPECT_FALSE(FileLock::acquire(path_, milliseconds(10)));
  ::kill(child, SIGKILL);
  ::waitpid(child, nullptr, 0);
  EXPECT_TRUE(std::filesystem::exists(path_));  // its file is still there
  EXPECT_TRUE(FileLock::acquire(path_, milliseconds(0)));
}

TEST_F(FileLockTest, AFolderThatIsMissingGivesNoLock) {
  EXPECT_FALSE(FileLock::acquire(folder_ / "missing" / "a.lock", milliseconds(0)));
  EXPECT_FALSE(FileLock::acquire(folder_, milliseconds(0)));  // a folder is not a file
}

}  // namespace
}  // namespace earshot
