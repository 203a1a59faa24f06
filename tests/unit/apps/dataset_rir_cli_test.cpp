// SPDX-License-Identifier: Apache-2.0
// `earshot dataset rir` as a user runs it, and interrupts it.

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <signal.h>
#include <sys/wait.h>
#include <unistd.h>

#include <algorithm>
#include <chrono>
#include <cstdlib>
#include <filesystem>
#include <string>
#include <thread>

#include "sim/base/files.h"
#include "sim/base/text/json.h"
#include "tests/support/envs/env_cases.h"
#include "tests/support/envs/rir_corpus_cases.h"
#include "tests/support/files/test_paths.h"

namespace earshot {
namespace {

using corpus_cases::differences;
using corpus_cases::lines_of;
using corpus_cases::tree;
using testing::HasSubstr;

constexpr const char* kConfig =
    "seed: 3\nshoeboxes: {count: 6, max_size_m: [5, 3, 5]}\nsources_per_room: 2\nlisteners_per_source: 10\nrooms_per_folder: 2\n"
    "acoustics: {rays: 16, rir_length_s: 0.2}\n";

class DatasetRirCli : public testing::Test {
 protected:
  DatasetRirCli() { write_text(path("rir.yaml"), kConfig); }
  [[nodiscard]] std::string path(const std::string& name) const { return (folder_.path() / name).string(); }
  struct Outcome {
    int exit_code = -1;
    std::string text;
  };
  [[nodiscard]] Outcome earshot(const std::string& arguments) const {
    const int status = std::system((earshot_program().string() + " " + arguments + " >" + path("output") + " 2>&1").c_str());
    return {WIFEXITED(status) ? WEXITSTATUS(status) : -1, read_file(path("output"))};
  }
  /// Starts the program and kills it once a file matches.
  void kill_when_exists(const std::string& out, const std::filesystem::path& file) const {
    const pid_t child = ::fork();
    if (child == 0) {
      const std::string program = earshot_program().string(), config = path("rir.yaml");
      ::execl(program.c_str(), program.c_str(), "dataset", "rir", config.c_str(), "--out", out.c_str(), "--threads", "2", nullptr);
      ::_exit(127);
    }
    for (int tries = 0; tries < 60'000 && !std::filesystem::exists(file); ++tries)
      std::this_thread::sleep_for(std::chrono::milliseconds(1));
    ::kill(child, SIGKILL);
    int status = 0;
    ASSERT_EQ(::waitpid(child, &status, 0), child);
    EXPECT_TRUE(std::filesystem::exists(file));
  }

  TestFolder folder_{"dataset_rir_cli"};
};

TEST_F(DatasetRirCli, AKilledRunIsCompletedWithTheSameBytes) {
  const Outcome whole = earshot("dataset rir " + path("rir.yaml") + " --out " + path("whole"));
  ASSERT_EQ(whole.exit_code, 0) << whole.text;
  EXPECT_THAT(whole.text, HasSubstr("complete, 120 responses"));
  const std::string out = path("killed");
  kill_when_exists(out, folder_.path() / "killed/00000/000000_s00_l0003.wav");
  EXPECT_FALSE(std::filesystem::exists(folder_.path() / "killed/manifest.jsonl"));
  kill_when_exists(out, folder_.path() / "killed/00001/000002_s01_l0001.wav");
  const Outcome completed = earshot("dataset rir " + path("rir.yaml") + " --out " + out);
  EXPECT_EQ(completed.exit_code, 0) << completed.text;
  EXPECT_EQ(differences(tree(folder_.path() / "killed"), tree(folder_.path() / "whole")), std::vector<std::string>{});
}

// A response of a corpus is that of `earshot rir` between the places that the manifest states.
TEST_F(DatasetRirCli, AResponseIsThatOfTheCommandRir) {
  ASSERT_EQ(earshot("dataset rir " + path("rir.yaml") + " --set shoeboxes.count=1 --out " + path("corpus")).exit_code, 0);
  const auto line = lines_of(folder_.path() / "corpus/manifest.jsonl").at(4);
  const auto point = [](const nlohmann::json& place) {
    return json_text(place[0]) + "," + json_text(place[1]) + "," + json_text(place[2]);
  };
  const Outcome rir =
      earshot("rir '" + line["scene"].get<std::string>() + "' --source " + point(line["source"]["position_m"]) + " --source-heading " +
              json_text(line["source"]["heading_deg"]) + " --listener " + point(line["listener"]["position_m"]) + " --heading " +
              json_text(line["listener"]["heading_deg"]) + " --preset fast --set rays=16 --set rir_length_s=0.2 --out " + path("one.wav"));
  ASSERT_EQ(rir.exit_code, 0) << rir.text;
  EXPECT_TRUE(read_file(path("one.wav")) == read_file(folder_.path() / "corpus" / line["file"].get<std::string>()));
}

TEST_F(DatasetRirCli, WhatIsWrongIsOneLine) {
  const auto refused = [&](const std::string& arguments, const std::string& text) {
    const Outcome outcome = earshot("dataset rir " + arguments);
    EXPECT_EQ(outcome.exit_code, 2) << outcome.text;
    EXPECT_THAT(outcome.text, HasSubstr(text));
    EXPECT_EQ(std::ranges::count(outcome.text, '\n'), 1) << outcome.text;
  };
  const std::string config = path("rir.yaml") + " --out " + path("refused");
  refused(path("none.yaml") + " --out " + path("refused"), "none.yaml");
  refused(config + " --set acoustics.raya=3", "did you mean 'rays'");
  refused(config + " --shard 3/2", "K from 1 to N");
  refused(config + " --threads -1", "--threads");
  refused(config + " --set min_distance_m=30 --set max_distance_m=40", "no free position for a listener 30 to 40 m from a source");
  EXPECT_FALSE(std::filesystem::exists(folder_.path() / "refused/manifest.jsonl"));
}

// The config that ships is read whole, and a corner of it is written.
TEST_F(DatasetRirCli, TheConfigThatShipsWorks) {
  const Outcome outcome = earshot("dataset rir " + (source_dir() / "configs/datasets/rir.yaml").string() +
                                  " --set shoeboxes.count=1 --set 'scenes=[\"house:3,rooms=1,area_m2=20\"]' --set sources_per_room=1 --set "
                                  "listeners_per_source=2 --out " +
                                  path("shipped"));
  EXPECT_EQ(outcome.exit_code, 0) << outcome.text;
  EXPECT_EQ(lines_of(folder_.path() / "shipped/manifest.jsonl").size(), 4u);
}

}  // namespace
}  // namespace earshot
