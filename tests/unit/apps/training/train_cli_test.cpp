// SPDX-License-Identifier: Apache-2.0
// `earshot train` and what follows it, as a user runs them: a run never mixes with an older one.

#include "tests/support/programs/train_cli.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cstdlib>
#include <filesystem>
#include <map>

#include "sim/base/files.h"

namespace earshot {
namespace {

using testing::AllOf;
using testing::HasSubstr;

TEST_F(TrainCli, ASecondRunIntoAFolderIsRefusedUnlessTold) {
  const std::string train = "train " + path("tiny.yaml");
  expect_done("dataset episodes --config " + path("tiny.yaml"));
  const Outcome first = earshot(train);
  EXPECT_EQ(first.exit_code, 0) << first.text;
  EXPECT_THAT(first.text, HasSubstr("16 of 16 steps taken"));
  EXPECT_THAT(first.text, testing::Not(HasSubstr("ratio alarm"))) << "the learner evaluates the policy that acted";
  EXPECT_THAT(checkpoints(), testing::IsSupersetOf({"last.ckpt", "update_000003.ckpt", "update_000004.ckpt"}));
  EXPECT_THAT(checkpoints(), testing::Not(testing::Contains("update_000002.ckpt"))) << "keep: 2";

  // By one process alone and by the one that would start the workers.
  for (const char* workers : {"", " --workers 2"})
    expect_refused(train + workers, AllOf(HasSubstr(path("run")), HasSubstr("--overwrite"), HasSubstr("--resume")));
  expect_refused(train + " --overwrite --resume " + path("run"), HasSubstr("--overwrite"));
  write_text(path("run/notes.txt"), "mine");

  expect_refused(train + " env.task.turn_deg=15 --resume " + path("run"), HasSubstr("env.task.turn_deg = 10, but the resumed run has 15"));
  expect_done(train + " --resume " + path("run") + " --change ppo.learning_rate ppo.learning_rate=1e-4 total_steps=48");
  EXPECT_THAT(checkpoints(), testing::IsSupersetOf({"last.ckpt", "update_000005.ckpt", "update_000006.ckpt"}));

  expect_done(train + " --overwrite seed=4 total_steps=8");
  EXPECT_THAT(checkpoints(), testing::IsSupersetOf({"last.ckpt", "update_000001.ckpt"}));
  EXPECT_THAT(checkpoints(), testing::Not(testing::Contains("update_000006.ckpt")));
  EXPECT_EQ(read_file(path("run/notes.txt")), "mine");
}

TEST_F(TrainCli, AStaleEpisodeSetIsRefusedAndMadeAnew) {
  const std::string config = path("tiny.yaml");
  expect_done("dataset episodes --config " + config);
  expect_refused("train " + config + " data.train.seed=5",
                 AllOf(HasSubstr("train.json.gz: was made with data.seed = 0, but the config has 5"),
                       HasSubstr("earshot dataset episodes --config " + config + " --set data.train.seed=5")));
  expect_refused("eval random --config " + config + " --set data.eval.episodes_per_scene=3", HasSubstr("data.episodes_per_scene = 2"));
  expect_done("eval random --config " + config + " --set data.eval.episodes_per_scene=3 --episodes " + path("eval.json.gz"));
  expect_done("dataset episodes --config " + config + " --set data.eval.episodes_per_scene=3");
  expect_done("eval random --config " + config + " --set data.eval.episodes_per_scene=3");

  // An evaluated checkpoint brings its config: its held-out set has been replaced.
  expect_done("train " + config + " total_steps=8");
  expect_refused("eval " + path("run"), HasSubstr("data.episodes_per_scene = 3, but the config has 2"));
  expect_done("dataset episodes --config " + config);
  expect_done("eval " + path("run"));
}

TEST_F(TrainCli, APolicyFileIsEvaluatedAndStartsAnotherRun) {
  const std::string config = path("tiny.yaml"), policy = path("tiny.policy");
  expect_done("dataset episodes --config " + config);
  expect_done("train " + config + " total_steps=16");
  expect_done("policy " + path("run") + " --out " + policy);
  EXPECT_LT(std::filesystem::file_size(policy), std::filesystem::file_size(path("run/checkpoints/last.ckpt")) / 2);
  EXPECT_THAT(earshot("policy " + policy).text,
              AllOf(HasSubstr(policy + ": policy"), HasSubstr("trained       16 steps"), HasSubstr("tiny")));
  EXPECT_THAT(earshot("policy " + path("run")).text, HasSubstr("training checkpoint"));

  // The same agent, to the last action.
  expect_done("eval " + path("run") + " --out " + path("a.json"));
  expect_done("eval " + policy + " --out " + path("b.json"));
  EXPECT_EQ(read_file(path("a.json")), read_file(path("b.json")));
  expect_done("policy " + path("run") + " --float16 --out " + path("half.policy"));
  EXPECT_LT(std::filesystem::file_size(path("half.policy")), std::filesystem::file_size(policy));
  expect_done("eval " + path("half.policy"));

  // Its config is one to train with.
  write_text(path("again.yaml"), earshot("policy " + policy + " --config").text);
  expect_done("train " + path("again.yaml") + " out=" + path("tuned") + " total_steps=8 workers=1 initial_policy=" + policy);
  expect_refused("train " + config + " --resume " + policy + " out=" + path("none") + " total_steps=16",
                 AllOf(HasSubstr("is a policy"), HasSubstr("initial_policy=" + policy)));
  expect_refused("train " + config + " out=" + path("none") + " policy.hidden_size=9 initial_policy=" + policy, HasSubstr("gru 9"));
  expect_refused("train " + config + " --workers 2 out=" + path("none") + " initial_policy=" + path("absent"), HasSubstr("absent"));
  expect_refused("policy " + policy + " --float16", HasSubstr("--out"));
  EXPECT_FALSE(std::filesystem::exists(path("none")));
}

}  // namespace
}  // namespace earshot
