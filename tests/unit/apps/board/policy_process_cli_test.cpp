// SPDX-License-Identifier: Apache-2.0
// A policy that others have written, in a process of its own.

#include <fmt/format.h>
#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <sys/stat.h>

#include <algorithm>
#include <csignal>
#include <cstring>
#include <filesystem>
#include <fstream>
#include <msgpack.hpp>
#include <string>

#include "evaluation/results/result.h"
#include "sim/base/files.h"
#include "sim/base/random.h"
#include "tests/support/programs/background_program.h"
#include "tests/support/programs/board_rules_cli.h"
#include "tests/support/wait_until.h"
#include "trainer/checkpoint/checkpoint_format.h"

namespace earshot {
namespace {

using testing::AllOf;
using testing::AnyOf;
using testing::HasSubstr;

class PolicyProcessCli : public BoardRulesCli {
 protected:
  /// The same file with another text in its config, and a hash that fits.
  void write_with_config(const std::string& file, const std::string& from, const std::string& to, const std::string& out) const {
    const std::string bytes = read_file(file);
    const msgpack::object_handle body = unpack_checkpoint(bytes, file);
    msgpack::sbuffer buffer;
    msgpack::packer packer(buffer);
    packer.pack_map(body->via.map.size);
    for (const auto& [key, value] : std::span(body->via.map.ptr, body->via.map.size)) {
      packer.pack(key);
      std::string text;
      if (key.as<std::string>() == "config_yaml") text = value.as<std::string>();
      const std::size_t at = text.find(from);
      if (text.empty()) {
        packer.pack(value);
        continue;
      }
      ASSERT_NE(at, std::string::npos) << text;
      packer.pack(text.replace(at, from.size(), to));
    }
    const std::string packed(buffer.data(), buffer.size());
    const std::uint64_t length = packed.size(), hash = hash64(packed);
    std::string head = bytes.substr(0, kCheckpointHeaderBytes);
    std::memcpy(head.data() + head.size() - sizeof length, &length, sizeof length);
    write_text(out, head + packed + std::string(reinterpret_cast<const char*>(&hash), sizeof hash));
  }
  /// Of the process of the policy that a running evaluation has started; 0: none.
  static pid_t policy_process_of(pid_t parent) {
    for (const auto& entry : std::filesystem::directory_iterator("/proc")) {
      std::ifstream line(entry.path() / "cmdline");
      const std::string words{std::istreambuf_iterator<char>(line), {}};
      if (words.find("policy-process") != std::string::npos &&
          words.find(std::string(1, '\0') + std::to_string(parent) + '\0') != std::string::npos)
        return static_cast<pid_t>(std::stol(entry.path().filename()));
    }
    return 0;
  }
};

// A policy or a result may name any path as a file of microphones.  A pipe that is opened would never answer.
TEST_F(PolicyProcessCli, MicrophoneFilesOfOthersAreNotOpened) {
  const auto refused_at_once = [&](const std::string& arguments, const std::string& line) {
    const std::string said = bash("timeout 60 " + earshot_program().string() + " " + arguments + "; echo code $?");
    EXPECT_THAT(said, AllOf(HasSubstr(line), HasSubstr("code 2\n"))) << arguments;
    EXPECT_EQ(std::ranges::count(said, '\n'), 2) << said;
  };
  constexpr const char* kNotOpened = "no file is opened for agents of others";
  const std::string ears = policy("ears", "");
  expect_done("eval " + ears + board() + " --out " + path("ears.json"));
  for (const char* name : {"pipe", "pipe.json", "pipe.yaml"}) ASSERT_EQ(::mkfifo(path(name).c_str(), 0600), 0);
  for (const std::string& channels :
       {"array:" + path("pipe"), "array:" + path("none"), "mono:" + path("pipe.json"), "mono:" + path("pipe.yaml")}) {
    write_with_config(ears, "channels: binaural", "channels: \"" + channels + "\"", path("others.policy"));
    for (const char* track : {"", " --track anything"})
      refused_at_once("eval " + path("others.policy") + board() + track + " --out " + path("others.json"), kNotOpened);
    EXPECT_FALSE(std::filesystem::exists(path("others.json")));
    EvaluationResult result = load_result(path("ears.json"));
    result.senses["observation.channels"] = channels;
    for (const char* track : {"", "anything"}) {
      result.track = track;
      save_result(result, path("forged.json"));
      refused_at_once("leaderboard " + path("forged.json") + board(), kNotOpened);
      refused_at_once("verify " + path("forged.json") + board(), kNotOpened);
    }
  }
  // The process of a policy opens none of a benchmark either.
  write_text(path("mics.yaml"), "microphones: [{name: a}, {name: b}]");
  std::string text = read_file(path("board.yaml"));
  const std::string observation = "observation: {";
  const std::size_t at = text.find(observation) + observation.size();
  for (const auto& [file, line] : {std::pair("mics.yaml", kNotOpened), {"pipe", "is a device, a pipe or a socket"}}) {
    write_text(path("files.yaml"), std::string(text).insert(at, "channels: \"array:" + path(file) + "\", "));
    refused_at_once("eval " + ears + " --benchmark " + path("files.yaml"), line);
  }
}

TEST_F(PolicyProcessCli, HonestPoliciesHaveTheBitsOfOneProcess) {
  const std::string file = policy("ears", "");
  expect_bits_of_one_process(file);
  // The limit is on what the policy takes, not on what libtorch maps before it is read (more than that).
  expect_done("eval " + file + board() + " --sample --policy-memory-gb 0.25 --out " + path("small.json"));
  EXPECT_EQ(json_of("small.json")["checksum"], json_of("apart.json")["checksum"]);
}

TEST_F(PolicyProcessCli, TooMuchMemoryIsRefusedInOneLine) {
  const std::string file = policy("ears", "");
  expect_refused("eval " + file + board() + " --policy-memory-gb 0.001 --out " + path("none.json"),
                 AnyOf(HasSubstr("needs more than 1 MB of memory"), HasSubstr("ends its process")));
  // A network of 2 kB that says it is one of terabytes, or gigabytes.
  for (const char* width : {"100000000", "2000000"}) {
    write_with_config(file, "visual_features: 8", fmt::format("visual_features: {}", width), path("large.policy"));
    const std::string said = bash("ulimit -v 12000000; timeout 300 " + earshot_program().string() + " eval " + path("large.policy") +
                                  board() + " --policy-memory-gb 0.5 --out " + path("none.json") + "; echo code $?");
    EXPECT_THAT(said, AllOf(HasSubstr("large.policy"), HasSubstr("code 2\n"))) << said;
    EXPECT_LE(std::ranges::count(said, '\n'), 3) << said;
  }
  EXPECT_FALSE(std::filesystem::exists(path("none.json")));
}

TEST_F(PolicyProcessCli, APolicyThatDoesNotAnswerIsEnded) {
  const std::string file = policy("ears", "");
  BackgroundProgram evaluation({"eval", file, "--benchmark", path("board.yaml"), "--policy-seconds", "20", "--out", path("none.json")},
                               path("said"));
  pid_t process = 0;
  ASSERT_TRUE(wait_until([&] { return (process = policy_process_of(evaluation.pid())) != 0; }));
  ::kill(process, SIGSTOP);
  EXPECT_EQ(evaluation.wait(), 2);
  EXPECT_THAT(evaluation.text(), HasSubstr("did not answer within 20 s"));
  EXPECT_FALSE(std::filesystem::exists(path("none.json")));
  EXPECT_NE(::kill(process, 0), 0);
}

TEST_F(PolicyProcessCli, TruncatedAndDamagedPoliciesAreRefusedInOneLine) {
  const std::string bytes = read_file(policy("ears", ""));
  for (std::uint32_t i = 0; i < 6; ++i) {
    const RandomStream random(11, Purpose::test, i);
    std::string damaged = bytes.substr(0, static_cast<std::size_t>(random.uniform(0) * static_cast<float>(bytes.size())));
    if (i % 2 == 1) {
      damaged = bytes;
      damaged[static_cast<std::size_t>(random.uniform(1) * static_cast<float>(bytes.size() - 1))] ^= 0x40;
    }
    write_text(path("damaged.policy"), damaged);
    expect_refused("eval " + path("damaged.policy") + board() + " --out " + path("none.json"), HasSubstr("damaged.policy: "));
  }
  EXPECT_FALSE(std::filesystem::exists(path("none.json")));
}

}  // namespace
}  // namespace earshot
