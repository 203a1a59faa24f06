// SPDX-License-Identifier: Apache-2.0
#include <gtest/gtest.h>

#include <stdexcept>
#include <string>

#include "sim/base/files.h"
#include "tests/support/files/pinned_rows.h"
#include "tests/support/files/test_paths.h"

namespace earshot {
namespace {

const std::string kRows =
    "stage,toolchain,instruction set,hash\n"
    "a,g++12/x1|g++14/x2,x86-64-v3+avx2,01\n"
    "a,g++12/x1,x86-64-v3+avx512,02\n"
    "b,g++12,x86-64-v3+avx2,03\n";

TEST(PinnedRows, HaveTheHashOfTheirStageToolchainAndInstructionSet) {
  EXPECT_EQ(pinned::pinned_hash(kRows, {"a", "g++12/x1", "x86-64-v3+avx2"}), "01");
  EXPECT_EQ(pinned::pinned_hash(kRows, {"a", "g++14/x2", "x86-64-v3+avx2"}), "01");
  EXPECT_EQ(pinned::pinned_hash(kRows, {"a", "g++12/x1", "x86-64-v3+avx512"}), "02");
  EXPECT_EQ(pinned::pinned_hash(kRows, {"b", "g++12", "x86-64-v3+avx2"}), "03");
  for (const pinned::Key& key : {pinned::Key{"a", "g++12", "x86-64-v3+avx2"}, pinned::Key{"a", "g++14/x2", "x86-64-v3+avx512"},
                                 pinned::Key{"b", "g++12", "armv8-a"}, pinned::Key{"c", "g++12", "x86-64-v3+avx2"}})
    EXPECT_EQ(pinned::pinned_hash(kRows, key), "") << pinned::row_of(key, "");
}

TEST(PinnedRows, RowToAddIsFound) {
  const pinned::Key key{"c", "g++13", "armv8-a"};
  EXPECT_EQ(pinned::pinned_hash(kRows + pinned::row_of(key, "04") + "\n", key), "04");
}

TEST(PinnedRows, TwoOfOneKeyAndMissingColumnsAreErrors) {
  EXPECT_THROW(pinned::pinned_hash(kRows + "a,g++14/x2,x86-64-v3+avx2,05\n", {"a", "g++14/x2", "x86-64-v3+avx2"}), std::runtime_error);
  EXPECT_THROW(pinned::pinned_hash(kRows + "c,g++12,06\n", {"b", "g++12", "x86-64-v3+avx2"}), std::runtime_error);
}

TEST(PinnedRows, EveryKeyOfTheFileHasOneHash) {
  const std::string csv = read_file((source_dir() / "tests/pinned/bits.csv").string());
  std::istringstream rows(csv);
  std::string row;
  std::getline(rows, row);
  EXPECT_EQ(row, "stage,toolchain,instruction set,hash");
  int seen = 0;
  for (; std::getline(rows, row); ++seen) {
    const std::vector<std::string> columns = pinned::split(row, ',');
    ASSERT_EQ(columns.size(), 4u) << row;
    EXPECT_EQ(columns[3].size(), 16u) << row;
    for (const std::string& toolchain : pinned::split(columns[1], '|'))
      EXPECT_EQ(pinned::pinned_hash(csv, {columns[0], toolchain, columns[2]}), columns[3]) << row;
  }
  EXPECT_GT(seen, 0);
}

TEST(PinnedRows, MissingOnesFailInCiAloneUnlessAllowed) {
  EXPECT_TRUE(pinned::missing_row_fails("1", nullptr, true));
  EXPECT_TRUE(pinned::missing_row_fails("true", "0", true));
  EXPECT_FALSE(pinned::missing_row_fails("1", "1", true));
  EXPECT_FALSE(pinned::missing_row_fails(nullptr, nullptr, true));
  EXPECT_FALSE(pinned::missing_row_fails("", nullptr, true));
  EXPECT_FALSE(pinned::missing_row_fails("1", nullptr, false));
}

}  // namespace
}  // namespace earshot
