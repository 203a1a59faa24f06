// SPDX-License-Identifier: Apache-2.0
#include "trainer/checkpoint/run_folder.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <set>

#include "sim/base/errors.h"
#include "sim/base/files.h"
#include "tests/support/workers/worker_processes.h"

namespace earshot {
namespace {

class RunFolderTest : public testing::Test {
 protected:
  void write(const std::string& name) { write_file_atomically(folder_.path() / name, "x"); }
  /// Every file below the folder, relative to it.
  [[nodiscard]] std::set<std::string> files() const {
    std::set<std::string> names;
    for (const auto& entry : std::filesystem::recursive_directory_iterator(folder_.path()))
      if (entry.is_regular_file()) names.insert(std::filesystem::relative(entry.path(), folder_.path()).string());
    return names;
  }
  PrivateTestFolder folder_;
  RunFolder run_{folder_.path()};
};

TEST_F(RunFolderTest, OverwritingRemovesOnlyWhatARunWrites) {
  const std::set<std::string> user_files{"train.json.gz",   "eval.json.gz",         "result_quick.json",     "notes.txt",
                                         "curve.svg.bak",   "quarantine/mine.json", "checkpoints/notes.txt", "exports/update_000001.ckpt",
                                         "events.jsonl.gz", "quarantine/a_123.json"};
  for (const std::string& name : user_files) write(name);
  for (const char* name :
       {"checkpoints/update_000050.ckpt", "checkpoints/update_1000000.ckpt", "checkpoints/last.ckpt", "checkpoints/best.ckpt",
        "events.jsonl", "curve.svg", "events.out.tfevents.0000000001.host.1.0", "quarantine/sound_0123456789abcdef.json"})
    write(name);
  EXPECT_EQ(run_.checkpoints().size(), 4u);
  run_.remove_run();
  EXPECT_EQ(files(), user_files);
  EXPECT_TRUE(run_.checkpoints().empty());
}

// find_checkpoint would take it for one of the new run.
TEST_F(RunFolderTest, ACheckpointOfAnotherNameIsKeptAndStopsTheOverwriting) {
  for (const char* name : {"checkpoints/copy.ckpt", "best_ever.ckpt", "checkpoints/update_12x.ckpt"}) {
    write(name);
    write("checkpoints/last.ckpt");
    write("events.jsonl");
    try {
      run_.remove_run();
      ADD_FAILURE() << name;
    } catch (const InputError& error) {
      EXPECT_THAT(error.what(), testing::HasSubstr(std::filesystem::path(name).filename().string()));
    }
    EXPECT_EQ(files(), (std::set<std::string>{name, "checkpoints/last.ckpt", "events.jsonl"}));
    std::filesystem::remove(folder_.path() / name);
  }
}

TEST_F(RunFolderTest, AFolderThatIsNotThereHoldsNothing) {
  const RunFolder missing_folder(folder_.path() / "none");
  EXPECT_TRUE(missing_folder.checkpoints().empty());
  missing_folder.remove_run();
  EXPECT_FALSE(std::filesystem::exists(missing_folder.path()));
}

TEST_F(RunFolderTest, SurplusIsWhatIsOldOrOfALaterUpdate) {
  for (const char* name : {"checkpoints/update_000010.ckpt", "checkpoints/update_000020.ckpt", "checkpoints/update_000030.ckpt",
                           "checkpoints/update_000040.ckpt", "checkpoints/best.ckpt", "checkpoints/last.ckpt", "checkpoints/mine.ckpt"})
    write(name);
  run_.remove_surplus(30, 2, false);
  EXPECT_EQ(files(), (std::set<std::string>{"checkpoints/update_000020.ckpt", "checkpoints/update_000030.ckpt", "checkpoints/best.ckpt",
                                            "checkpoints/mine.ckpt"}));
  write("checkpoints/last.ckpt");
  run_.remove_surplus(35, 2, true);
  EXPECT_TRUE(files().contains("checkpoints/last.ckpt"));
}

}  // namespace
}  // namespace earshot
