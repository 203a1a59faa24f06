// SPDX-License-Identifier: Apache-2.0
// What others change while a command works: the checkpoint of a run, its episodes, the folder of temporary files.

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <sys/stat.h>

#include <algorithm>
#include <atomic>
#include <chrono>
#include <filesystem>
#include <nlohmann/json.hpp>
#include <set>
#include <string>
#include <thread>

#include "sim/base/files.h"
#include "tests/support/programs/board_cli.h"

namespace earshot {
namespace {

using testing::AllOf;
using testing::HasSubstr;

class LiveRunCli : public BoardCli {
 protected:
  /// The last checkpoint of a training with this seed, alone in a file.
  std::string trained(const std::string& seed) const {
    expect_done("train " + path("tiny.yaml") + " --overwrite seed=" + seed);
    std::filesystem::copy_file(path("run/checkpoints/last.ckpt"), path(seed + ".ckpt"));
    return path(seed + ".ckpt");
  }
};

TEST_F(LiveRunCli, AllWorkersEvaluateOneCheckpointOfARunThatGoesOn) {
  make_episodes(6);
  const std::string first = trained("3"), second = trained("4"), episodes = " --episodes " + path("eval.json.gz");
  std::set<std::string> hashes;
  for (const std::string& file : {first, second}) {
    expect_done("eval " + file + episodes + " --out " + path("own.json"));
    hashes.insert(json_of("own.json")["policy_hash"]);
  }
  ASSERT_EQ(hashes.size(), 2u);
  std::filesystem::remove_all(path("run/checkpoints"));
  std::filesystem::create_directory(path("run/checkpoints"));
  std::filesystem::copy_file(first, path("run/checkpoints/last.ckpt"));
  std::atomic<bool> is_over{false};
  std::jthread run([&] {
    for (int i = 0; !is_over; ++i) {
      std::filesystem::copy_file(i % 2 == 0 ? second : first, path("run/next"), std::filesystem::copy_options::overwrite_existing);
      std::filesystem::rename(path("run/next"), path("run/checkpoints/last.ckpt"));
      std::this_thread::sleep_for(std::chrono::milliseconds(1));
    }
  });
  for (const char* workers : {"2", "1"}) {
    expect_done("eval " + path("run") + episodes + " --workers " + workers + " --out " + path("live.json"));
    EXPECT_TRUE(hashes.contains(json_of("live.json")["policy_hash"]));
  }
  is_over = true;
}

TEST_F(LiveRunCli, AnotherNumberOfWorkersGoesOnInTheSameEpisodes) {
  make_episodes(2);
  // A set from elsewhere, of which the config says nothing.
  std::string config = read_file(path("tiny.yaml"));
  config = config.substr(0, config.find("data:\n")) + "data: {train: {file: " + path("own.json.gz") + "}}\n";
  write_text(path("own.yaml"), config);
  const std::string make =
      "dataset episodes shoebox:6x3x5@0.3 --count 6 --set data.train.filter.min_geodesic_m=1 --set data.train.filter.min_ratio=1 --out " +
      path("own.json.gz");
  expect_done(make + " --seed 1");
  expect_done("train " + path("own.yaml"));
  const std::string resume = "train " + path("own.yaml") + " --workers 2 total_steps=64 --resume " + path("run");
  const std::string before = read_file(path("run/checkpoints/last.ckpt"));
  expect_done(make + " --seed 2");
  expect_refused(resume + " --change workers", AllOf(HasSubstr("has other episodes"), HasSubstr("--change workers,data.train.file")));
  expect_refused(resume, HasSubstr("has other episodes"));
  EXPECT_EQ(read_file(path("run/checkpoints/last.ckpt")), before);
  expect_done(resume + " --change workers,data.train.file");
}

TEST_F(LiveRunCli, AFolderOfTemporaryFilesThatCannotBeIsNamedAtOnce) {
  make_episodes(2);
  write_text(path("file"), "");
  for (const std::string& folder : {path("nowhere"), path("file"), std::string("/proc")})
    for (const std::string& command : {"eval random --workers 2 --config " + path("tiny.yaml") + " --out " + path("result.json"),
                                       "train " + path("tiny.yaml") + " --workers 2", std::string("bench allreduce --quick"),
                                       std::string("bench scaling --quick"), std::string("bench soak --steps 1")}) {
      const std::string said = bash("TMPDIR=" + folder + " " + earshot_program().string() + " " + command + "; echo code $?");
      EXPECT_THAT(said, AllOf(testing::StartsWith("earshot: TMPDIR=" + folder + ": "), HasSubstr("set TMPDIR"), HasSubstr("code 2\n")))
          << command;
      EXPECT_EQ(std::ranges::count(said, '\n'), 2) << said;
    }
  EXPECT_FALSE(std::filesystem::exists(path("result.json")));
  EXPECT_FALSE(std::filesystem::exists(path("run")));
}

// A result says where its episodes were; what is read is what its verifier says.
TEST_F(LiveRunCli, AResultDoesNotDecideWhatIsRead) {
  make_episodes(2);
  std::filesystem::create_directories(path("sets/deep"));
  std::filesystem::copy_file(path("eval.json.gz"), path("sets/eval.json.gz"));
  const std::string result = path("result.json");
  expect_done("eval random --config " + path("tiny.yaml") + " --episodes " + path("eval.json.gz") + " --out " + result);
  expect_refused("verify " + result, HasSubstr("a result does not decide what is read"));
  for (const std::string& option : {" --episodes " + path("eval.json.gz"), " --episodes " + path("sets"), " --config " + path("tiny.yaml")})
    expect_done("verify " + result + option);
  ASSERT_EQ(::mkfifo(path("sets/pipe").c_str(), 0600), 0);
  std::filesystem::create_symlink(path("eval.json.gz"), path("sets/link"));
  nlohmann::json forged = json_of("result.json");
  for (const std::string& place :
       {std::string("/etc/passwd"), std::string("/dev/zero"), path("sets/pipe"), path("sets/link"), std::string("pipe"),
        std::string("link"), path("sets/../train.json.gz"), std::string("../train.json.gz")}) {
    forged["episodes_file"] = place;
    write_text(path("forged.json"), json_text(forged));
    expect_refused("verify " + path("forged.json") + " --episodes " + path("sets"), HasSubstr("which is not in " + path("sets")));
    expect_refused("verify " + path("forged.json"), HasSubstr("a result does not decide what is read"));
  }
  forged["episodes_file"] = "/etc/passwd";
  std::filesystem::create_directory(path("elsewhere"));
  write_text(path("elsewhere/forged.json"), json_text(forged));
  expect_refused("replay " + path("elsewhere/forged.json") + " --episode 0 --html " + path("page.html"), HasSubstr("which is not in"));
}

}  // namespace
}  // namespace earshot
