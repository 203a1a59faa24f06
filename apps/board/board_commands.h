// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <CLI/CLI.hpp>
#include <string>
#include <utility>
#include <vector>

#include "evaluation/leaderboard/benchmark.h"
#include "evaluation/results/verify_result.h"
#include "sim/base/output_paths.h"

namespace earshot {

/// Commands about results and what they are results of; as those of commands.h.
void add_benchmark(CLI::App& app);
void add_verify(CLI::App& app);
void add_sweep(CLI::App& app, int& exit_code);
/// Knows the commands that were added before it, and itself.
void add_completion(CLI::App& app);
void add_eval(CLI::App& app, const std::vector<std::string>& arguments, int& exit_code);

/// Options of every command that verifies results.
void add_verify_options(CLI::App& command, VerifyConfig& config);
/// The episode sets that a benchmark names: they are read, or made.
std::vector<InputPath> sets_of(const Benchmark& benchmark);
/// check_outputs over those that are named: {option, path}.
void check_named_outputs(std::vector<OutputPath> outputs, const std::vector<InputPath>& inputs);
/// "ADDRESS=TEXT" of --link.  Throws InputError.
std::pair<std::string, std::string> parse_link(const std::string& text);

/// What `verify` says of a result that holds.
std::string verified_line(const std::string& file, const Verification& verified, const std::string& rules);

}  // namespace earshot
