// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <fmt/format.h>

#include <string>

#include "envs/episodes/episode_set.h"
#include "evaluation/leaderboard/benchmark.h"
#include "sim/base/files.h"
#include "tests/support/programs/board_cli.h"

namespace earshot {

/// A benchmark of the tiny room, with policies that are trained for seconds.
class BoardRulesCli : public BoardCli {
 protected:
  BoardRulesCli() {
    make_episodes(3);
    const RunConfig config = load_run_config(path("tiny.yaml"), {});
    write_text(path("board.yaml"),
               fmt::format("benchmark:\n  name: room\n  version: 1\n  set_hash: \"{}\"\n  rules_hash: \"{}\"\n  senses_hash: \"{}\"\n",
                           hex64(load_episode_set(path("eval.json.gz")).hash), hash_of_rules(metric_rules(config.env, config.eval_envs)),
                           hash_of_senses(sensed_config(config.env), default_tracks())) +
                   read_file(path("tiny.yaml")));
  }
  /// Trains a policy with these keys, and exports it.
  std::string policy(const std::string& name, const std::string& keys) const {
    expect_done("train " + path("tiny.yaml") + " out=" + path(name) + " name=" + name + " " + keys);
    expect_done("policy " + path(name) + " --out " + path(name + ".policy"));
    return path(name + ".policy");
  }
  /// The benchmark, whose policy runs in a process of its own, has the bits of an evaluation in the process of the command, with several
  /// workers too.  Leaves apart.json.
  void expect_bits_of_one_process(const std::string& file) const {
    for (const char* choice : {" --argmax", " --sample"}) {
      expect_done("eval " + file + board() + choice + " --out " + path("apart.json"));
      expect_done("eval " + file + board() + choice + " --workers 2 --out " + path("workers.json"));
      expect_done("eval " + file + " --episodes " + path("eval.json.gz") + choice + " --out " + path("here.json"));
      const auto here = json_of("here.json"), apart = json_of("apart.json");
      for (const char* key : {"episodes", "policy_hash", "summary", "rules", "senses", "toolchain"})
        EXPECT_EQ(here[key], apart[key]) << key;
      EXPECT_EQ(json_of("workers.json")["checksum"], apart["checksum"]);
    }
  }
  [[nodiscard]] std::string board() const { return " --benchmark " + path("board.yaml"); }
};

}  // namespace earshot
