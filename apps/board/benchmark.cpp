// SPDX-License-Identifier: Apache-2.0
#include "evaluation/leaderboard/benchmark.h"

#include <fmt/format.h>

#include <memory>
#include <nlohmann/json.hpp>

#include "apps/board/board_commands.h"
#include "apps/options/output_options.h"
#include "evaluation/leaderboard/private_set.h"
#include "sim/base/errors.h"
#include "sim/base/files.h"
#include "sim/base/text/json.h"

namespace earshot {

namespace {

struct BenchmarkArguments {
  std::string file, json, private_file, new_private_file;
};

void run_benchmark(const BenchmarkArguments& options) {
  if (!options.private_file.empty() && !options.new_private_file.empty())
    throw InputError("--make-private", "cannot be combined with --private: one writes the private set, the other reads it",
                     "give only one of them");
  const Benchmark benchmark = load_benchmark(options.file);
  check_named_outputs({{"--json", options.json}, {"--make-private", options.new_private_file}}, sets_of(benchmark));
  if (!options.new_private_file.empty()) {
    const std::string sha256 = make_private_set(benchmark, options.new_private_file);
    fmt::print(
        "{}: private set of {} {} written; keep this file secret, and add this line to section `benchmark` of {}:\n"
        "  private: {{sha256: \"{}\"}}\n",
        options.new_private_file, benchmark.name, benchmark.version, options.file, sha256);
    if (options.json.empty()) return;
    const nlohmann::ordered_json report{
        {"schema_version", 1}, {"benchmark", benchmark.name}, {"version", benchmark.version}, {"private_sha256", sha256}};
    write_file_atomically(options.json, json_text(report, 2) + "\n");
    return;
  }
  check_splits(benchmark);
  const EpisodeSet set = benchmark_set(benchmark);
  fmt::print("{} {}: {} episodes in {}, set {}, rules {}; training and test set have no scene in common, and {}\n", benchmark.name,
             benchmark.version, set.episodes.size(), benchmark.run.eval.file, hex64(set.hash), benchmark.rules_hash,
             benchmark.heard_sounds.empty() ? "no sound" : "no sound except the declared heard_sounds");
  nlohmann::ordered_json report{{"schema_version", 1},
                                {"benchmark", benchmark.name},
                                {"version", benchmark.version},
                                {"episodes_file", benchmark.run.eval.file},
                                {"episodes", set.episodes.size()},
                                {"set_hash", hex64(set.hash)},
                                {"rules_hash", benchmark.rules_hash},
                                {"seed", benchmark.seed},
                                {"private_sha256", benchmark.private_sha256}};
  if (!options.private_file.empty()) {
    const Benchmark hidden = with_private_set(benchmark, options.private_file);
    const EpisodeSet private_set = benchmark_set(hidden);
    check_private_split(benchmark, private_set);
    fmt::print("{}: private set of {} {}: {} episodes, set {}; it has no scene or sound of the training and public sets{}\n",
               options.private_file, benchmark.name, benchmark.version, private_set.episodes.size(), hidden.set_hash,
               benchmark.heard_sounds.empty() ? "" : ", except the declared heard_sounds");
    report["private_episodes"] = private_set.episodes.size();
    report["private_set_hash"] = hidden.set_hash;
  }
  if (!options.json.empty()) write_file_atomically(options.json, json_text(report, 2) + "\n");
}

}  // namespace

void add_benchmark(CLI::App& app) {
  auto options = std::make_shared<BenchmarkArguments>();
  CLI::App* command =
      app.add_subcommand("benchmark", "Check a benchmark: its rules, its test set, and that training and test sets do not overlap");
  command->add_option("BENCHMARK", options->file, "Benchmark file, for example configs/benchmarks/quick.yaml")->required();
  command->add_option(
      "--private", options->private_file,
      "Also check the private set in this file: its SHA-256 must be the one in the benchmark; overlaps with the other sets are listed");
  command
      ->add_option("--make-private", options->new_private_file,
                   "Instead: draw a new private set from secret random numbers and write it to this file (for maintainers of a benchmark)")
      ->type_name(kOutputFile);
  command->add_option("--json", options->json, "Also write the findings to this JSON file")->type_name(kOutputFile);
  command->footer("Generates the test set (data.eval.file) if it is missing, and refuses a set whose hash differs from the benchmark's.");
  command->callback([options] { run_benchmark(*options); });
}

}  // namespace earshot
