#include <fmt/format.h>

#include <memory>
#include <nlohmann/json.hpp>
#include <optional>

#include "apps/board/board_commands.h"
#include "evaluation/leaderboard/benchmark.h"
#include "evaluation/leaderboard/private_set.h"
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
  if (!benchmark && !options.private_file.empty()) throw InputError("--private", "is a set of a benchmark", "name it with --benchmark");
  if (!options.private_file.empty()) benchmark = with_private_set(*benchmark, options.private_file);
  if (!options.config.empty()) config = load_run_config(options.config, options.overrides);
  if (!config && !options.overrides.empty()) throw InputError("--set", "has no effect without --config", "leave it out");
  if (benchmark && (config || !options.episodes.empty()))
    throw InputError("--benchmark", "names rules and episodes itself", "leave out --config and --episodes");
  if (const RunConfig* run = benchmark ? &benchmark->run : config ? &*config : nullptr) {
    if (options.verify.scene_root.empty()) options.verify.scene_root = run->env.scene_root;
    if (options.verify.sound_root.empty()) options.verify.sound_root = run->env.sound_root;
  }
  std::optional<EpisodeSet> set_of_all;
  if (benchmark) set_of_all = benchmark_set(*benchmark);
  if (!options.episodes.empty()) set_of_all = load_episode_set(options.episodes);
  nlohmann::ordered_json rows = nlohmann::ordered_json::array();
  const auto note = [&](const std::string& file, const Verification& verified, const std::string& rules_hash) {
    rows.push_back({{"file", file},
                    {"episodes", verified.episodes},
                    {"steps", verified.steps},
                    {"partial", verified.partial},
                    {"same_engine", verified.same_engine},
                    {"toolchain", verified.toolchain},
                    {"rules_hash", rules_hash}});
  };
  for (const std::string& file : options.results) {
    const EvaluationResult result = load_result(file);
    if (benchmark) {
      const Verification verified = verify_for_benchmark(result, file, *benchmark, *set_of_all, options.verify);
      fmt::print("{}", verified_line(file, verified,
                                     fmt::format("of benchmark {} {}{}", benchmark->name, benchmark->version,
                                                 options.private_file.empty() ? "" : ", private set")));
      note(file, verified, benchmark->rules_hash);
      continue;
    }
    const EpisodeSet own = set_of_all ? EpisodeSet{} : load_episode_set(result.episodes_file);
    if (!config && result.rules.empty())
      throw InputError(file, "does not say by which rules it was run: it is older than that",
                       "name the run's config with --config, or evaluate the agent again");
    const MetricRules rules = config ? rules_for(result.rules, metric_rules(config->env, config->eval_envs)) : result.rules;
    const Verification verified = verify_result(result, file, set_of_all ? *set_of_all : own, rules, options.verify);
    fmt::print("{}", verified_line(file, verified, config ? "of " + options.config : "hash " + hash_of_rules(rules) + ", its own"));
    note(file, verified, hash_of_rules(rules));
  }
  const nlohmann::ordered_json report{{"schema_version", 1}, {"results", std::move(rows)}};
  if (!options.json.empty()) write_file_atomically(options.json, json_text(report, 2) + "\n");
}

}  // namespace

void add_verify_options(CLI::App& command, VerifyConfig& config) {
  command.add_option("--threads", config.threads, "Threads that verify; 0: all cores")->capture_default_str()->check(CLI::Range(0, 1024));
  command.add_flag("--any-engine", config.any_engine,
                   "Also results of other builds of the program: their numbers must be those of this one nevertheless");
  command.add_flag("--partial", config.partial, "Also results of the first episodes of a set (eval --max-episodes)");
  command.add_option("--scene-root", config.scene_root, "Folder of relative scene files");
  command.add_option("--sound-root", config.sound_root, "Folder of sounds that are named without a path");
}

std::string verified_line(const std::string& file, const Verification& verified, const std::string& rules) {
  return fmt::format("{}: verified, {} episodes{}, {} steps; rules {}{}\n", file, verified.episodes,
                     verified.partial ? " (the first of a set)" : "", verified.steps, rules,
                     verified.same_engine         ? ""
                     : verified.toolchain.empty() ? "; made by another engine"
                                                  : "; made by another engine with " + verified.toolchain);
}

void add_verify(CLI::App& app) {
  auto options = std::make_shared<VerifyArguments>();
  CLI::App* command = app.add_subcommand("verify", "Walk the actions of results again and refuse those whose numbers differ by a bit");
  command->add_option("RESULT", options->results, "Result files written by 'earshot eval --out'")->required();
  command->add_option("--benchmark", options->benchmark, "Benchmark (configs/benchmarks) whose rules and episodes they must have");
  command->add_option("--private", options->private_file, "The benchmark's private set in this file, in the place of its test set");
  command->add_option("--config", options->config, "Run config whose rules they must have (default: the rules that each file names)");
  command->add_option("--set", options->overrides, "key=value over --config");
  command->add_option("--episodes", options->episodes, "Episode set (default: the file that each result names)");
  add_verify_options(*command, options->verify);
  command->add_option("--json", options->json, "Also write what was verified to a file, where all was");
  command->footer(
      "One line on stderr and exit code 2 for the first result that is not what its actions give, with the first episode that shows it.\n"
      "Without --benchmark or --config a result may name easier rules than others: compare the hash of the rules.");
  command->callback([options] { run_verify(*options); });
}

}  // namespace earshot
