// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdlib>
#include <nlohmann/json.hpp>
#include <string>

#include "sim/base/text/json.h"
#include "tests/support/programs/train_cli.h"

namespace earshot {

/// Evaluations, leaderboards and sweeps, as a user starts them.
class BoardCli : public TrainCli {
 protected:
  void make_episodes(int count) const {
    expect_done("dataset episodes --config " + path("tiny.yaml") + " --set data.eval.episodes_per_scene=" + std::to_string(count));
  }
  [[nodiscard]] nlohmann::json json_of(const std::string& name) const { return parse_json(read_file(path(name))); }
  /// A line of bash; what it prints.
  [[nodiscard]] std::string bash(const std::string& line) const {
    write_text(path("line.sh"), line);
    std::system(("bash " + path("line.sh") + " >" + path("said") + " 2>&1").c_str());
    return read_file(path("said"));
  }
};

}  // namespace earshot
