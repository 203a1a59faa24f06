// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <gtest/gtest.h>

#include <nlohmann/json.hpp>
#include <string>

#include "sim/base/text/json.h"
#include "tests/support/programs/cli.h"

namespace earshot {

/// Tests of the metrics that `earshot rir` writes.
class RirCli : public Cli {
 protected:
  /// Of one response to an omnidirectional microphone; `arguments` as after `earshot rir`.  Fails the test if the program does.
  [[nodiscard]] nlohmann::json metrics(const std::string& arguments) const {
    const CliOutcome outcome = earshot("rir " + arguments + " --channels mono --out " + file("r.wav") + " --metrics " + file("r.json"));
    EXPECT_EQ(outcome.exit_code, 0) << arguments << "\n" << outcome.errors;
    return outcome.exit_code == 0 ? parse_json(read("r.json")) : nlohmann::json();
  }
};

}  // namespace earshot
