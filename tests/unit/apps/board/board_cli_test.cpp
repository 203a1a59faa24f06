// SPDX-License-Identifier: Apache-2.0
// Commands around results: evaluation in several processes, replay pages, sweeps, tables as JSON, completion.

#include "tests/support/programs/board_cli.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <filesystem>
#include <nlohmann/json.hpp>
#include <string>

#include "evaluation/results/result.h"
#include "sim/base/files.h"
#include "sim/base/text/json.h"

namespace earshot {
namespace {

using Json = nlohmann::json;
using testing::AllOf;
using testing::HasSubstr;

TEST_F(BoardCli, AKilledWorkerEndsTheEvaluationWithOneLine) {
  make_episodes(150);
  const std::string said =
      bash(earshot_program().string() + " eval random --config " + path("tiny.yaml") + " --set env.task.max_steps=500 --episodes " +
           path("eval.json.gz") + " --workers 2 --out " + path("result.json") +
           " & pid=$!\n"
           "for i in $(seq 400); do read -r worker rest </proc/$pid/task/$pid/children; [ -n \"$rest\" ] && break; sleep 0.02; done\n"
           "kill -9 $worker; wait $pid; echo code $?\n");
  EXPECT_THAT(said, AllOf(HasSubstr("was killed by signal 9"), HasSubstr("code 3\n")));
  EXPECT_EQ(std::ranges::count(said, '\n'), 2) << said;  // the error and the code
  EXPECT_FALSE(std::filesystem::exists(path("result.json")));
  // What is wrong with the input is said once, before any worker starts.
  expect_refused("eval random --config " + path("tiny.yaml") + " --workers 2", HasSubstr("episodes_per_scene"));
}

TEST_F(BoardCli, PartsOfAnEvaluationAreJoinedOrRefused) {
  make_episodes(3);
  const std::string common = "eval random --config " + path("tiny.yaml") + " --episodes " + path("eval.json.gz");
  expect_done(common + " --out " + path("one.json"));
  const std::string parts = " --parts " + path("parts");
  expect_done(common + parts + " --shard 2/2 --out " + path("joined.json"));
  EXPECT_FALSE(std::filesystem::exists(path("joined.json")));
  expect_refused(common + parts + " --shard 1/2 --seed 1",
                 AllOf(HasSubstr("another evaluation"), HasSubstr("'seed: 0' there, 'seed: 1' here")));
  expect_refused(common + parts + " --shard 1/3", HasSubstr("'parts: 2' there, 'parts: 3' here"));
  expect_refused(common + parts, HasSubstr("--shard K/N and --parts FOLDER"));
  expect_refused(common + parts + " --shard 1/2 --workers 2", HasSubstr("--workers"));
  expect_refused(common + parts + " --shard 1/2 --benchmark any.yaml", HasSubstr("cannot be combined with --benchmark"));
  expect_refused(common + parts + " --shard 1/2 --set env.stage_limit_s=1", HasSubstr("env.stage_limit_s"));
  expect_done(common + parts + " --shard 1/2 --out " + path("joined.json"));
  EXPECT_EQ(read_file(path("joined.json")), read_file(path("one.json")));
}

TEST_F(BoardCli, ReplayWritesAPageOfWhatHappened) {
  make_episodes(3);
  expect_done("eval oracle --config " + path("tiny.yaml") + " --set env.task.max_steps=200 --episodes " + path("eval.json.gz") + " --out " +
              path("result.json"));
  const std::string replay = "replay " + path("result.json") + " --config " + path("tiny.yaml") + " --html " + path("page.html");
  expect_done(replay + " --episode best --link board.html=leaderboard");
  const std::string page = read_file(path("page.html"));
  const std::size_t begin = page.find("id=\"episode\">") + 13;
  const Json episode = parse_json(page.substr(begin, page.find("</script>", begin) - begin));
  EXPECT_EQ(episode["schema_version"], 1);
  EXPECT_EQ(episode["links"][0]["href"], "board.html");
  const std::size_t index = episode["episode"]["index"];
  const Json row = json_of("result.json")["episodes"][index];
  EXPECT_EQ(episode["steps"].size(), row["actions"].size() + 1);
  for (std::size_t i = 0; i < row["actions"].size(); ++i) EXPECT_EQ(episode["steps"][i + 1]["action"], row["actions"][i]);
  EXPECT_EQ(episode["pictures"]["rgb"].size(), episode["steps"].size());
  EXPECT_EQ(episode["audio"]["samples"], episode["steps"].size() * episode["samples_per_step"].get<std::size_t>());
  EXPECT_TRUE(page.find("<script src") == std::string::npos && page.find("<link") == std::string::npos) << "needs other files";

  expect_refused(replay + " --episode 3", HasSubstr("write a number from 0 to 2"));
  expect_refused(replay, HasSubstr("--episode"));
  expect_refused("replay " + path("result.json") + " --episode 0", HasSubstr("--html"));
  expect_refused("replay " + path("result.json") + " --link a=b", HasSubstr("--link"));
  Json forged = json_of("result.json");
  forged["episodes"][index]["spl"] = 0.25;
  write_text(path("result.json"), json_text(forged));
  expect_refused(replay + " --episode " + std::to_string(index), HasSubstr("reports spl = 0.25"));
}

TEST_F(BoardCli, TablesAreThereAsJson) {
  make_episodes(3);
  expect_done("eval random --config " + path("tiny.yaml") + " --episodes " + path("eval.json.gz") + " --out " + path("result.json") +
              " --json " + path("eval_table.json"));
  expect_done("leaderboard " + path("result.json") + " --json " + path("board.json") + " --html " + path("board.html") +
              " --link page.html=best");
  for (const std::string& file : {std::string("eval_table.json"), std::string("board.json")}) {
    const Json table = json_of(file);
    EXPECT_EQ(table["schema_version"], 1);
    EXPECT_EQ(table["agents"][0]["rank"], 1);
    EXPECT_EQ(table["agents"][0]["episodes"], 3);
    EXPECT_TRUE(table["agents"][0]["metrics"]["spl"].contains("low"));
  }
  EXPECT_THAT(read_file(path("board.html")), HasSubstr("<a href=\"page.html\">best</a>"));
}

TEST_F(BoardCli, GroupsByPlaceAreThoseOfTheSetThatWasRun) {
  make_episodes(3);
  expect_done("eval random --config " + path("tiny.yaml") + " --episodes " + path("eval.json.gz") + " --out " + path("result.json"));
  const std::string board = "leaderboard " + path("result.json") + " --by distance";
  expect_done(board + " --json " + path("board.json"));
  EXPECT_FALSE(json_of("board.json")["groups"].empty());
  // The same scenes and names of episodes with other places in the same file.
  std::filesystem::remove(path("eval.json.gz"));
  expect_done("dataset episodes --config " + path("tiny.yaml") + " --set data.eval.episodes_per_scene=3 --set data.eval.seed=9");
  expect_refused(board, HasSubstr("episode set is not available"));
  expect_done("leaderboard " + path("result.json") + " --html " + path("board.html"));
  EXPECT_THAT(read_file(path("board.html")), testing::Not(HasSubstr("By geodesic distance")));
}

TEST_F(BoardCli, PagesTakeAgentsOfTheResultsAlone) {
  make_episodes(2);
  expect_done("eval random --config " + path("tiny.yaml") + " --episodes " + path("eval.json.gz") + " --out " + path("result.json"));
  const std::string board = "leaderboard " + path("result.json") + " --html " + path("board.html");
  expect_refused(board + " --run-here random", AllOf(HasSubstr("--run-here"), HasSubstr("without --benchmark")));
  expect_refused(board + " --replay randon=a.html=best", AllOf(HasSubstr("--replay randon"), HasSubstr("without a result")));
  EXPECT_FALSE(std::filesystem::exists(path("board.html")));
  expect_done(board + " --replay random=a.html=best");
}

TEST_F(BoardCli, ShellsCompleteCommandsAndOptions) {
  const std::string program = earshot_program().string();
  EXPECT_EQ(bash("source <(" + program + " completion bash); COMP_WORDS=(earshot ev); COMP_CWORD=1; _earshot; echo ${COMPREPLY[@]}"),
            "eval\n");
  EXPECT_EQ(bash("source <(" + program +
                 " completion bash); COMP_WORDS=(earshot eval random --work); COMP_CWORD=3; _earshot; echo ${COMPREPLY[@]}"),
            "--workers\n");
  EXPECT_EQ(
      bash("source <(" + program + " completion bash); COMP_WORDS=(earshot dataset ep); COMP_CWORD=2; _earshot; echo ${COMPREPLY[@]}"),
      "episodes\n");
  EXPECT_THAT(bash("! command -v zsh >/dev/null || zsh -n <(" + program + " completion zsh)"), testing::IsEmpty());
  EXPECT_THAT(bash(program + " completion zsh"), AllOf(HasSubstr("#compdef earshot"), HasSubstr("eval) _earshot_eval ;;")));
  EXPECT_THAT(bash(program + " completion man"), AllOf(HasSubstr(".TH EARSHOT 1"), HasSubstr(".SS \"earshot eval\"")));
  EXPECT_THAT(bash(program + " completion bash"), testing::Not(HasSubstr("--part-folder")));  // no user's option
}

}  // namespace
}  // namespace earshot
