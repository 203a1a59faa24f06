// SPDX-License-Identifier: Apache-2.0
// A training at a stated accuracy, which is planned once.

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cstdlib>
#include <filesystem>
#include <map>

#include "sim/base/files.h"
#include "tests/support/programs/train_cli.h"

namespace earshot {
namespace {

using testing::AllOf;
using testing::HasSubstr;

TEST_F(TrainCli, AccuracyIsPlannedOnceAndKeptWithTheRun) {
  // As tiny.yaml, but for what the planner chooses.
  std::string yaml = read_file(path("tiny.yaml"));
  const std::string chosen = "acoustics: {rays: 4, rir_length_s: 0.1, early_order: 0}";
  ASSERT_NE(yaml.find(chosen), std::string::npos);
  expect_done("dataset episodes --config " + path("tiny.yaml"));
  expect_refused("plan " + path("tiny.yaml"), HasSubstr("has no env.accuracy"));
  expect_refused("train " + path("tiny.yaml") + " env.accuracy=edc=3dB", HasSubstr("is a key that env.accuracy chooses"));
  yaml.replace(yaml.find(chosen), chosen.size(), "accuracy: edc=3dB\n  acoustics: {rir_length_s: 0.3}");
  write_text(path("asked.yaml"), yaml);
  const std::string train = "train " + path("asked.yaml");

  // A worker of a launcher does not plan: each would choose for itself.
  const std::map<const char*, std::string> launcher = {
      {"EARSHOT_RANK", "0"}, {"EARSHOT_WORLD_SIZE", "2"}, {"EARSHOT_RENDEZVOUS", "tcp://127.0.0.1:29555"}, {"EARSHOT_RUN_ID", "1"}};
  for (const auto& [name, value] : launcher) ASSERT_EQ(::setenv(name, value.c_str(), 1), 0);
  expect_refused(train, AllOf(HasSubstr("has no plan"), HasSubstr("earshot plan " + path("asked.yaml"))));
  for (const auto& [name, value] : launcher) ASSERT_EQ(::unsetenv(name), 0);

  EXPECT_THAT(earshot("train " + path("asked.yaml") + " --workers 2").text, HasSubstr("written to"));
  std::vector<std::filesystem::path> plans;
  for (const auto& entry : std::filesystem::directory_iterator(folder_.path() / "run"))
    if (entry.path().filename().string().starts_with("acoustics_")) plans.push_back(entry.path());
  ASSERT_EQ(plans.size(), 1u);
  EXPECT_THAT(earshot("plan " + path("asked.yaml")).text, HasSubstr("already planned"));

  // The run that is resumed, elsewhere too, hears what it heard before.
  const Outcome resumed = earshot(train + " total_steps=48 out=" + path("elsewhere") + " --workers 2 --resume " + path("run"));
  EXPECT_EQ(resumed.exit_code, 0) << resumed.text;
  EXPECT_THAT(resumed.text, testing::Not(HasSubstr("written to")));
  // Evaluation of a checkpoint and of a baseline need no plan of their own.
  expect_done("eval " + path("run"));
  const Outcome baseline = earshot("eval greedy --config " + path("asked.yaml"));
  EXPECT_EQ(baseline.exit_code, 0) << baseline.text;
  EXPECT_THAT(baseline.text, testing::Not(HasSubstr("written to")));

  // A plan that was cut off is said to be.
  const std::string text = read_file(plans.front());
  write_text(plans.front(), text.substr(0, text.find("acoustics:")));
  expect_refused(train + " --overwrite", AllOf(HasSubstr(plans.front().filename()), HasSubstr("is missing")));
}

}  // namespace
}  // namespace earshot
