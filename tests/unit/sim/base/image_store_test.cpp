// SPDX-License-Identifier: Apache-2.0
#include "sim/base/image_store.h"

#include <fcntl.h>
#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <sys/resource.h>
#include <sys/stat.h>
#include <sys/wait.h>
#include <unistd.h>

#include <chrono>
#include <csignal>
#include <fstream>
#include <iterator>
#include <vector>

#include "sim/base/files.h"
#include "tests/support/files/image_store_fixture.h"

namespace earshot {
namespace {

using testing::HasSubstr;

constexpr std::uint64_t kKey = 0x0123456789abcdef;
constexpr std::size_t kHeader = 64;

TEST_F(ImageStoreTest, WhatWasSavedIsLoadedByAnyStoreOfTheFolder) {
  const auto image = image_of(1);
  ImageStore writer = open();
  EXPECT_FALSE(writer.load(kKey));
  ASSERT_TRUE(writer.save(kKey, image));
  ImageStore reader = open();
  const auto loaded = reader.load(kKey);
  ASSERT_TRUE(loaded);
  EXPECT_TRUE(equal(loaded->bytes, image));
  EXPECT_EQ(reinterpret_cast<std::uintptr_t>(loaded->bytes.data()) % 64, 0u);
  EXPECT_FALSE(reader.load(kKey + 1));
  EXPECT_EQ(num_files(), 1u);
  EXPECT_EQ(writer.path_of(kKey).filename(), "0123456789abcdef.field");
  EXPECT_TRUE(warnings_.empty());
}

// Every single bit of a small file, and every shorter length: either the true image comes back (a bit of the reserved words) or none does.
TEST_F(ImageStoreTest, NoFlippedBitAndNoCutGoesUnseen) {
  const auto image = image_of(2, 40);
  ImageStore store = open();
  ASSERT_TRUE(store.save(kKey, image));
  const std::string whole = read_file(store.path_of(kKey));
  ASSERT_EQ(whole.size(), kHeader + image.size());
  std::size_t refused = 0;
  std::fstream file(store.path_of(kKey), std::ios::binary | std::ios::in | std::ios::out);  // in place: replacing a file is slow
  const auto put = [&](std::size_t at, char value) {
    file.seekp(static_cast<std::streamoff>(at));
    file.put(value).flush();
  };
  for (std::size_t bit = 0; bit < 8 * whole.size(); ++bit) {
    put(bit / 8, static_cast<char>(whole[bit / 8] ^ (1 << bit % 8)));
    const auto loaded = store.load(kKey);
    if (loaded)
      EXPECT_TRUE(equal(loaded->bytes, image)) << bit;
    else
      ++refused;
    put(bit / 8, whole[bit / 8]);
  }
  EXPECT_EQ(refused, 8 * (32 + image.size()));  // four words of the header and the image; four words are reserved
  EXPECT_EQ(warnings_.size(), refused);
  for (std::size_t size = whole.size(); size-- > 0;) {
    std::filesystem::resize_file(store.path_of(kKey), size);
    EXPECT_FALSE(store.load(kKey)) << size;
  }
  write(store.path_of(kKey), whole + "x");
  EXPECT_FALSE(store.load(kKey));
  ASSERT_TRUE(store.save(kKey, image));  // made anew in the same place
  EXPECT_TRUE(store.load(kKey));
  EXPECT_EQ(num_files(), 1u);
}

TEST_F(ImageStoreTest, ForeignThingsCountAsMissing) {
  ImageStore store = open();
  ASSERT_TRUE(store.save(kKey + 1, image_of(3)));
  std::filesystem::copy_file(store.path_of(kKey + 1), store.path_of(kKey));  // whole, of another key
  EXPECT_FALSE(store.load(kKey));
  EXPECT_THAT(warnings_.back(), HasSubstr("another key"));
  write(store.path_of(kKey), std::string(500, 'x'));
  EXPECT_FALSE(store.load(kKey));
  EXPECT_THAT(warnings_.back(), HasSubstr("another kind"));
  std::filesystem::remove(store.path_of(kKey));
  ASSERT_EQ(::mkfifo(store.path_of(kKey).c_str(), 0600), 0);  // must not wait for a writer
  EXPECT_FALSE(store.load(kKey));
  std::filesystem::remove(store.path_of(kKey));
  std::filesystem::create_directory(store.path_of(kKey));
  EXPECT_FALSE(store.load(kKey));
  EXPECT_FALSE(store.save(kKey, image_of(3)));  // a folder is not replaced
  EXPECT_TRUE(std::filesystem::is_directory(store.path_of(kKey)));
  EXPECT_EQ(num_files(), 2u);  // and no temporary is left
}

TEST_F(ImageStoreTest, RejectedImagesAreRemoved) {
  ImageStore store = open();
  ASSERT_TRUE(store.save(kKey, image_of(4)));
  store.reject(kKey, "its cells are of another scene");
  EXPECT_FALSE(store.load(kKey));
  ASSERT_EQ(warnings_.size(), 1u);
  EXPECT_THAT(warnings_[0], HasSubstr("another scene"));
}

TEST_F(ImageStoreTest, TheLeastRecentlyUsedGoFirst) {
  const auto image = image_of(5, 1000);
  const std::uint64_t file = kHeader + image.size();
  ImageStore store = open(3 * file);
  for (std::uint64_t key = 0; key < 3; ++key) {
    ASSERT_TRUE(store.save(key, image));
    age(store.path_of(key), std::chrono::seconds(100 - 10 * key));  // 0 is the oldest
  }
  ASSERT_TRUE(store.load(0));  // and now the youngest
  ASSERT_TRUE(store.save(3, image));
  EXPECT_TRUE(store.load(0));
  EXPECT_FALSE(store.load(1));
  EXPECT_TRUE(store.load(2));
  EXPECT_TRUE(store.load(3));
  EXPECT_FALSE(store.save(4, image_of(5, 4000)));  // larger than the bound: not written, nothing removed for it
  EXPECT_EQ(num_files(), 3u);
}

TEST_F(ImageStoreTest, OtherVersionsCountAndGoAndOtherFilesStay) {
  const auto image = image_of(6, 1000);
  std::filesystem::create_directories(folder_);
  write(folder_ / "00000000000000aa.field-v0", std::string(2000, 'x'));
  write(folder_ / "notes.txt", std::string(9000, 'x'));
  write(folder_ / ".0000000000000001.99.5.0.tmp", std::string(9000, 'x'));  // left by a process that was ended long ago
  write(folder_ / ".0000000000000001.99.6.0.tmp", "x");                     // being written now
  age(folder_ / ".0000000000000001.99.5.0.tmp", std::chrono::hours(2));
  age(folder_ / "00000000000000aa.field-v0", std::chrono::hours(1));
  ImageStore store = open(2500);
  ASSERT_TRUE(store.save(kKey, image));
  EXPECT_TRUE(store.load(kKey));
  EXPECT_FALSE(std::filesystem::exists(folder_ / "00000000000000aa.field-v0"));
  EXPECT_TRUE(std::filesystem::exists(folder_ / "notes.txt"));
  EXPECT_FALSE(std::filesystem::exists(folder_ / ".0000000000000001.99.5.0.tmp"));
  EXPECT_TRUE(std::filesystem::exists(folder_ / ".0000000000000001.99.6.0.tmp"));
}

// Another process maps the image, this one removes and replaces it: the other still reads the bytes it mapped.
TEST_F(ImageStoreTest, ImagesThatAnotherProcessHoldsOutliveTheirFile) {
  const auto image = image_of(7, 1 << 20), other = image_of(8, 1 << 20);
  ImageStore store = open(std::uint64_t{3} << 20);
  ASSERT_TRUE(store.save(kKey, image));
  int to_child[2], from_child[2];
  ASSERT_EQ(::pipe(to_child), 0);
  ASSERT_EQ(::pipe(from_child), 0);
  const pid_t child = ::fork();
  if (child == 0) {
    char token = 'r';
    const auto loaded = store.load(kKey);
    if (::write(from_child[1], &token, 1) != 1 || ::read(to_child[0], &token, 1) != 1) ::_exit(2);
    ::_exit(loaded && equal(loaded->bytes, image) && loaded->owner ? 0 : 1);
  }
  char token = 0;
  ASSERT_EQ(::read(from_child[0], &token, 1), 1);
  const auto stored = store.load(kKey);
  std::filesystem::remove(store.path_of(kKey));
  ASSERT_TRUE(store.save(kKey, other));
  ASSERT_EQ(::write(to_child[1], &token, 1), 1);
  int status = 0;
  ASSERT_EQ(::waitpid(child, &status, 0), child);
  EXPECT_TRUE(WIFEXITED(status) && WEXITSTATUS(status) == 0);
  EXPECT_TRUE(equal(stored->bytes, image));
  EXPECT_TRUE(equal(store.load(kKey)->bytes, other));
  for (const int end : {to_child[0], to_child[1], from_child[0], from_child[1]}) ::close(end);
}

TEST_F(ImageStoreTest, WritersOfOneKeyLeaveOneWholeImage) {
  const auto image = image_of(9, 200'000);
  std::vector<pid_t> children;
  for (int i = 0; i < 4; ++i) {
    const pid_t child = ::fork();
    if (child == 0) {
      ImageStore own_store = open();
      bool good = true;
      for (int round = 0; round < 20; ++round) {
        good = own_store.save(kKey, image) && good;
        const auto loaded = own_store.load(kKey);
        good = loaded && equal(loaded->bytes, image) && good;
      }
      ::_exit(good && warnings_.empty() ? 0 : 1);
    }
    children.push_back(child);
  }
  for (const pid_t child : children) {
    int status = 0;
    ASSERT_EQ(::waitpid(child, &status, 0), child);
    EXPECT_TRUE(WIFEXITED(status) && WEXITSTATUS(status) == 0);
  }
  EXPECT_EQ(num_files(), 1u);
}

// A full disk, played by the limit on file sizes with its signal as it is by default: it would end the program.
TEST_F(ImageStoreTest, AFullDiskIsOneWarning) {
  const auto before_signal = std::signal(SIGXFSZ, SIG_DFL);
  ImageStore store = open();
  ASSERT_TRUE(store.save(kKey, image_of(10, 1000)));
  rlimit before{};
  getrlimit(RLIMIT_FSIZE, &before);
  const rlimit small{4096, before.rlim_max};
  setrlimit(RLIMIT_FSIZE, &small);
  const bool first = store.save(kKey, image_of(11, 100'000)), second = store.save(kKey + 1, image_of(12, 100'000));
  setrlimit(RLIMIT_FSIZE, &before);
  std::signal(SIGXFSZ, before_signal);
  EXPECT_FALSE(first);
  EXPECT_FALSE(second);
  EXPECT_EQ(warnings_.size(), 1u);
  EXPECT_EQ(num_files(), 1u);
  EXPECT_TRUE(equal(store.load(kKey)->bytes, image_of(10, 1000)));  // the old image is whole
  EXPECT_TRUE(store.save(kKey + 1, image_of(12, 100'000)));         // and when there is room again, it goes on
}

TEST_F(ImageStoreTest, AFolderThatCannotBeMadeIsOneWarning) {
  write(folder_, "a file");
  ImageStore store = open();
  EXPECT_FALSE(store.save(kKey, image_of(13)));
  EXPECT_FALSE(store.save(kKey, image_of(13)));
  EXPECT_FALSE(store.load(kKey));
  EXPECT_EQ(warnings_.size(), 1u);
}

// As an unprivileged user: permissions do not bind the superuser.
TEST_F(ImageStoreTest, WithoutPermissionNothingIsReadOrWritten) {
  ImageStore store = open();
  ASSERT_TRUE(store.save(kKey, image_of(14)));
  ASSERT_TRUE(store.save(kKey + 1, image_of(15)));
  ASSERT_EQ(::chmod(store.path_of(kKey).c_str(), 0), 0);
  ASSERT_EQ(::chmod(store.path_of(kKey + 1).c_str(), 0444), 0);
  ASSERT_EQ(::chmod(folder_.c_str(), 0555), 0);
  const pid_t child = ::fork();
  if (child == 0) {
    if (::geteuid() == 0 && ::setuid(65534) != 0) ::_exit(7);
    int wrong = 0;
    if (store.load(kKey)) wrong |= 1;
    if (store.save(kKey, image_of(16))) wrong |= 2;
    if (const auto readable = store.load(kKey + 1); !readable || !equal(readable->bytes, image_of(15))) wrong |= 4;  // read-only is enough
    if (warnings_.size() != 1) wrong |= 8;
    ::_exit(wrong);
  }
  int status = 0;
  ASSERT_EQ(::waitpid(child, &status, 0), child);
  ::chmod(folder_.c_str(), 0755);
  ASSERT_TRUE(WIFEXITED(status));
  EXPECT_EQ(WEXITSTATUS(status), 0);
}

}  // namespace
}  // namespace earshot
