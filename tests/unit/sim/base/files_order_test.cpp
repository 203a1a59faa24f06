// SPDX-License-Identifier: Apache-2.0
// What a file is worth after the power fails: its bytes are on disk before its name is, and its name before the call returns.  The
// functions of the C library below stand in for its own in this program, and write down who calls them.

#include <fcntl.h>
#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <sys/stat.h>
#include <sys/syscall.h>
#include <unistd.h>

#include <filesystem>
#include <string>
#include <vector>

#include "sim/base/files.h"
#include "sim/base/temporary_folder.h"

namespace {

std::vector<std::string>* g_calls = nullptr;  // null: nothing is written down

}  // namespace

extern "C" int fsync(int descriptor) {
  struct stat status {};
  if (g_calls && ::fstat(descriptor, &status) == 0)
    g_calls->push_back(S_ISDIR(status.st_mode) ? "fsync folder" : "fsync file of " + std::to_string(status.st_size) + " bytes");
  return static_cast<int>(::syscall(SYS_fsync, descriptor));
}

extern "C" int rename(const char* from, const char* to) noexcept {
  if (g_calls) g_calls->push_back("rename");
  return static_cast<int>(::syscall(SYS_renameat, AT_FDCWD, from, AT_FDCWD, to));
}

namespace earshot {
namespace {

TEST(FilesOrder, BytesAreOnDiskBeforeTheNameAndTheNameBeforeTheCallReturns) {
  const TemporaryFolder folder(std::filesystem::temp_directory_path(), "earshot_files_order_");
  const std::string text(100'000, 'x');
  for (int time = 0; time < 2; ++time) {  // a new file, and one in the place of another
    std::vector<std::string> calls;
    g_calls = &calls;
    write_file_atomically(folder.path() / "file", text);
    g_calls = nullptr;
    EXPECT_THAT(calls, testing::ElementsAre("fsync file of 100000 bytes", "rename", "fsync folder"));
    EXPECT_EQ(read_file(folder.path() / "file"), text);
  }
}

}  // namespace
}  // namespace earshot
