// SPDX-License-Identifier: Apache-2.0
#include <fmt/format.h>

#include <filesystem>
#include <memory>
#include <nlohmann/json.hpp>
#include <optional>

#include "apps/board/board_commands.h"
#include "apps/options/output_options.h"
#include "evaluation/leaderboard/benchmark.h"
#include "evaluation/leaderboard/private_set.h"
#include "evaluation/results/set_of_result.h"
#include "sim/base/files.h"
#include "sim/base/text/json.h"

namespace earshot {
namespace {

struct VerifyArguments {
  std::vector<std::string> results;
  std::string benchmark, private_file, config, episodes, json;
  std::vector<std::string> overrides;
  VerifyConfig verify;
};

void run_verify(VerifyArguments options) {
  std::optional<Benchmark> benchmark;
  std::optional<RunConfig> config;
  if (!options.benchmark.empty()) benchmark = load_benchmark(options.benchmark);
  if (!benchmark && !options.private_file.empty())
    throw InputError("--private", "needs a benchmark", "name the benchmark with --benchmark FILE");
  if (!options.private_file.empty()) benchmark = with_private_set(*benchmark, options.private_file);
  if (!options.config.empty()) config = load_run_config(options.config, options.overrides);
  if (!config && !options.overrides.empty()) throw InputError("--set", "has no effect without --config", "leave it out");
  if (benchmark && (config || !options.episodes.empty()))
    throw InputError("--benchmark", "already sets the rules and the episodes", "leave out --config and --episodes");
  if (const RunConfig* run = benchmark ? &benchmark->run : config ? &*config : nullptr) {
    if (options.verify.scene_root.empty()) options.verify.scene_root = run->env.scene_root;
    if (options.verify.sound_root.empty()) options.verify.sound_root = run->env.sound_root;
  }
  check_named_outputs({{"--json", options.json}}, benchmark ? sets_of(*benchmark) : std::vector<InputPath>{});
  if (options.episodes.empty() && config) options.episodes = config->eval.file;
  std::optional<EpisodeSet> set_of_all;
  if (benchmark) set_of_all = benchmark_set(*benchmark);
  const bool is_folder = std::filesystem::is_directory(options.episodes);
  if (!options.episodes.empty() && !is_folder) set_of_all = load_episode_set(options.episodes);
  nlohmann::ordered_json rows = nlohmann::ordered_json::array();
  const auto note = [&](const std::string& file, const Verification& verified, const std::string& rules_hash) {
    rows.push_back({{"file", file},
                    {"episodes", verified.episodes},
                    {"steps", verified.steps},
                    {"partial", verified.partial},
                    {"same_engine", verified.same_engine},
                    {"toolchain", verified.toolchain},
                    {"rules_hash", rules_hash},
                    {"track", verified.standing.track},
                    {"rests_on", "actions alone"}});
  };
  for (const std::string& file : options.results) {
    const EvaluationResult result = load_result(file);
    if (benchmark) {
      const Verification verified = verify_for_benchmark(result, file, *benchmark, *set_of_all, options.verify);
      fmt::print("{}", verified_line(
                           file, verified,
                           fmt::format("of benchmark {} {}{}; track {}, as it says; rests on its actions alone", benchmark->name,
                                       benchmark->version, options.private_file.empty() ? "" : ", private set", verified.standing.track)));
      note(file, verified, benchmark->rules_hash);
      continue;
    }
    if (!set_of_all && !is_folder)
      throw InputError(file, fmt::format("names the episode set '{}', and a result does not decide what is read", result.episodes_file),
                       "name the set with --episodes FILE, or its folder with --episodes FOLDER");
    const EpisodeSet result_set = set_of_all ? EpisodeSet{} : set_of_result(result, file, {options.episodes});
    if (!config && result.rules.empty())
      throw InputError(file, "does not contain its rules: an older version wrote it",
                       "give the config of the run with --config, or evaluate the agent again");
    const MetricRules rules = config ? rules_for(result.rules, metric_rules(config->env, config->eval_envs)) : result.rules;
    const Verification verified = verify_result(result, file, set_of_all ? *set_of_all : result_set, rules, options.verify);
    fmt::print("{}", verified_line(file, verified, config ? "of " + options.config : "hash " + hash_of_rules(rules) + ", its own"));
    note(file, verified, hash_of_rules(rules));
  }
  const nlohmann::ordered_json report{{"schema_version", 1}, {"results", std::move(rows)}};
  if (!options.json.empty()) write_file_atomically(options.json, json_text(report, 2) + "\n");
}

}  // namespace

void add_verify_options(CLI::App& command, VerifyConfig& config) {
  command.add_option("--threads", config.threads, "Verification threads; 0: all cores")->capture_default_str()->check(CLI::Range(0, 1024));
  command.add_flag("--any-engine", config.any_engine, "Also accept results of other builds; this build must still reproduce their numbers");
  command.add_flag("--partial", config.partial, "Also accept results of the first episodes of a set (eval --max-episodes)");
  command.add_option("--scene-root", config.scene_root, "Folder for relative paths of scene files");
  command.add_option("--sound-root", config.sound_root, "Folder for sound files without a path");
}

std::vector<InputPath> sets_of(const Benchmark& benchmark) {
  std::vector<InputPath> sets;
  for (const std::string& file : {benchmark.run.train.file, benchmark.run.eval.file})
    if (!file.empty()) sets.push_back({.option = "the benchmark", .path = file});
  return sets;
}

void check_named_outputs(std::vector<OutputPath> outputs, const std::vector<InputPath>& inputs) {
  std::erase_if(outputs, [](const OutputPath& output) { return output.path.empty(); });
  check_outputs(outputs, inputs);
}

std::string verified_line(const std::string& file, const Verification& verified, const std::string& rules) {
  return fmt::format("{}: verified, {} episodes{}, {} steps; rules {}{}\n", file, verified.episodes,
                     verified.partial ? " (the first of a set)" : "", verified.steps, rules,
                     verified.same_engine         ? ""
                     : verified.toolchain.empty() ? "; made by another build"
                                                  : "; made by another build with " + verified.toolchain);
}

void add_verify(CLI::App& app) {
  auto options = std::make_shared<VerifyArguments>();
  CLI::App* command =
      app.add_subcommand("verify", "Run the recorded actions of results again, and refuse a result whose numbers differ by one bit");
  command->add_option("RESULT", options->results, "Result files written by 'earshot eval --out'")->required();
  command->add_option("--benchmark", options->benchmark,
                      "Benchmark file (see configs/benchmarks) whose rules and episodes the results must have");
  command->add_option("--private", options->private_file,
                      "Verify against the benchmark's private set in this file instead of its test set");
  command->add_option("--config", options->config, "Run config whose rules the results must have (default: the rules in each result)");
  command->add_option("--set", options->overrides, "Override a key of --config: key=value; may be repeated");
  command->add_option("--episodes", options->episodes,
                      "Episode set, or the folder that holds the sets that the results name (default: data.eval.file of --config)");
  add_verify_options(*command, options->verify);
  command->add_option("--json", options->json, "Also write a report to this JSON file once all results are verified")
      ->type_name(kOutputFile);
  command->footer(
      "Stops at the first result that its actions do not reproduce: exit code 2 and one line that names the first differing episode.\n"
      "Without --benchmark or --config the rules of a result are its own, and may be easier than those of others: compare their hashes.");
  command->callback([options] { run_verify(*options); });
}

}  // namespace earshot
