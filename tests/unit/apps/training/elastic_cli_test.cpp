// SPDX-License-Identifier: Apache-2.0
// `earshot train --elastic`, as launchers start it again and again, and environments in another number of workers.
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <nlohmann/json.hpp>

#include "tests/support/programs/launchers_cli.h"

namespace earshot {
namespace {

using nlohmann::json;
using testing::AllOf;
using testing::HasSubstr;
using testing::Not;

class ElasticCli : public LaunchersCli {
 protected:
  /// Where the environments of all workers are, in the order of workers.
  [[nodiscard]] std::vector<json> envs_of(const std::string& run) const {
    const std::string where = path(run + "/checkpoints/last.ckpt"), file = read_file(where);
    const msgpack::object_handle body = unpack_checkpoint(file, where);
    std::vector<json> envs;
    for (const auto& state : CheckpointFields(where).value<std::vector<std::string>>(body.get(), "env_states")) {
      const json document = json::parse(state);
      for (const json& env : document.at("body").at("envs")) envs.push_back(env);
    }
    EXPECT_FALSE(envs.empty()) << where;
    return envs;
  }
  [[nodiscard]] std::string done(const std::string& arguments) const {
    const Outcome outcome = earshot(arguments);
    EXPECT_EQ(outcome.exit_code, 0) << arguments << "\n" << outcome.text;
    return outcome.text;
  }
  const std::string train_ = "train " + config_ + " --elastic ";
};

TEST_F(ElasticCli, StartsAndGoesOnWithAnyNumberOfWorkers) {
  EXPECT_THAT(done(train_), Not(HasSubstr("continuing from")));
  EXPECT_THAT(done(train_ + "--workers 2 total_steps=64"),
              AllOf(HasSubstr("continuing from " + path("run/checkpoints")), HasSubstr("with 2 workers"),
                    HasSubstr("2 workers x 2 environments instead of 1 x 2: 2 environments continue in their order, 2 start with new")));
  EXPECT_THAT(done(train_ + "total_steps=72"), HasSubstr("2 environments continue in their order, the last 2 are dropped"));
  // A run that has reached its end is left alone.
  const std::uint64_t bits = bits_of("run");
  expect_done(train_ + "total_steps=72 --workers 2");
  EXPECT_EQ(bits_of("run"), bits);
}

TEST_F(ElasticCli, TheSameNumberOfWorkersGivesTheBitsOfTheUnbrokenRun) {
  expect_done(train_ + "--workers 2 total_steps=64 out=" + path("whole"));
  expect_done(train_ + "--workers 2 total_steps=32");
  expect_done(train_ + "--workers 2 total_steps=64");
  EXPECT_EQ(bits_of("run"), bits_of("whole"));
  EXPECT_EQ(envs_of("run"), envs_of("whole"));
}

// A run that is resumed at its end makes no update: its last checkpoint tells where the environments went on.
TEST_F(ElasticCli, EnvironmentsGoOnWhereTheyWere) {
  expect_done("train " + config_ + " --workers 2");
  std::vector<json> before = envs_of("run");
  ASSERT_EQ(before.size(), 4u);
  for (const int workers : {3, 1, 3}) {
    expect_done("train " + config_ + " --change workers --resume " + path("run/checkpoints/last.ckpt") + " --workers " +
                std::to_string(workers));
    const std::vector<json> after = envs_of("run");
    ASSERT_EQ(after.size(), 2u * static_cast<unsigned>(workers));
    for (std::size_t i = 0; i < std::min(before.size(), after.size()); ++i) EXPECT_EQ(after[i], before[i]) << workers << " workers, " << i;
    for (std::size_t i = before.size(); i < after.size(); ++i) {
      EXPECT_EQ(after[i].at("episode_count"), 0) << i;
      for (std::size_t other = 0; other < i; ++other) EXPECT_NE(after[i].at("seed"), after[other].at("seed"));
    }
    before = after;
  }
}

TEST_F(ElasticCli, RefusesWhatContradictsIt) {
  expect_refused(train_ + "--resume " + path("run"), HasSubstr("leave out --resume"));
  expect_refused(train_ + "--overwrite", HasSubstr("--overwrite"));
  expect_refused(train_ + "--join", HasSubstr("--join"));
}

}  // namespace
}  // namespace earshot
