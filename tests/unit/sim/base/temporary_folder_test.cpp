// SPDX-License-Identifier: Apache-2.0
#include "sim/base/temporary_folder.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "sim/base/errors.h"
#include "sim/base/files.h"

namespace earshot {
namespace {

TEST(TemporaryFolder, IsPrivateAndGoesWithWhatIsInIt) {
  std::filesystem::path path;
  {
    const TemporaryFolder folder(std::filesystem::temp_directory_path(), "earshot-test-"), other(folder.path(), "in-");
    path = folder.path();
    EXPECT_TRUE(path.filename().string().starts_with("earshot-test-"));
    EXPECT_EQ(std::filesystem::status(path).permissions(), std::filesystem::perms::owner_all);
    EXPECT_EQ(other.path().parent_path(), path);
    write_file_atomically(other.path() / "file", "bytes");
  }
  EXPECT_FALSE(std::filesystem::exists(path));
}

TEST(TemporaryFolder, NamesTheFolderThatCannotBe) {
  try {
    const TemporaryFolder folder("/nowhere/at/all", "earshot-test-");
    FAIL();
  } catch (const RunError& error) {
    EXPECT_THAT(error.what(), testing::HasSubstr("/nowhere/at/all/earshot-test-"));
    EXPECT_THAT(error.what(), testing::HasSubstr("No such file"));
  }
}

}  // namespace
}  // namespace earshot
