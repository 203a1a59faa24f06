#include "trainer/leaderboard.h"

#include <fmt/format.h>

#include <map>
#include <memory>
#include <nlohmann/json.hpp>
#include <optional>

#include "apps/board_commands.h"
#include "apps/commands.h"
#include "sim/base/files.h"
#include "trainer/benchmark.h"
#include "trainer/paired_comparison.h"
#include "trainer/result_groups.h"

namespace earshot {
namespace {

struct Options {
  std::vector<std::string> results;
  std::string html, json, benchmark;
  std::vector<std::string> links;
  std::optional<GroupBy> by;
  bool compare = false;
  VerifyConfig verify;
};

/// Reads the results, and verifies them where a benchmark says by what.
std::vector<EvaluationResult> read_results(const Options& options) {
  std::optional<Benchmark> benchmark;
  EpisodeSet set;
  if (!options.benchmark.empty()) {
    benchmark = load_benchmark(options.benchmark);
    set = benchmark_set(*benchmark);
  }
  VerifyConfig verify = options.verify;
  if (benchmark && verify.scene_root.empty()) verify.scene_root = benchmark->run.env.scene_root;
  if (benchmark && verify.sound_root.empty()) verify.sound_root = benchmark->run.env.sound_root;
  std::vector<EvaluationResult> results;
  for (const auto& path : options.results) {
    EvaluationResult result = load_result(path);
    if (!result.partial_of.empty() && !verify.partial)
      throw InputError(path, fmt::format("is partial: the first {} episodes of its set alone", result.episodes.size()),
                       "evaluate the agent without --max-episodes, or say --partial");
    if (!result.is_as_written)
      throw InputError(path, "was changed after it was written: its checksum is another", "take the file as 'earshot eval --out' wrote it");
    if (benchmark) {
      verify_for_benchmark(result, path, *benchmark, set, verify);
      result.verified = true;
    }
    results.push_back(std::move(result));
  }
  return results;
}

nlohmann::ordered_json json_of(const PairedMetric& metric) {
  return {{"mean", metric.difference.mean}, {"low", metric.difference.low}, {"high", metric.difference.high}, {"better", metric.wins},
          {"worse", metric.losses},         {"equal", metric.ties},         {"p_value", metric.p_value}};
}

std::string comparison_json(const EvaluationResult& first, const EvaluationResult& second) {
  const PairedComparison comparison = compare_paired(first, second);
  const nlohmann::ordered_json json{{"schema_version", 1},
                                    {"first", first.agent},
                                    {"second", second.agent},
                                    {"episodes", first.episodes.size()},
                                    {"success", json_of(comparison.success)},
                                    {"spl", json_of(comparison.spl)}};
  return json.dump(2) + "\n";
}

void run_leaderboard(const Options& options) {
  if (options.compare && options.results.size() != 2)
    throw InputError("--compare", "takes two results", "name the two agents' result files");
  if (options.html.empty() && !options.links.empty()) throw InputError("--link", "has no effect without a page", "say --html");
  if (options.compare && !options.html.empty())
    throw InputError("--html", "writes the table, which --compare takes the place of", "leave one out");
  const std::vector<EvaluationResult> results = read_results(options);
  if (options.compare) {
    fmt::print("{}", comparison_text(results[0], results[1]));
    if (!options.json.empty()) write_file_atomically(options.json, comparison_json(results[0], results[1]));
    return;
  }
  fmt::print("{}", leaderboard_text(results));
  if (options.benchmark.empty())
    fmt::print(
        "not verified here: these are the numbers that the files hold (earshot verify, or --benchmark, walks their actions again)\n");
  if (options.by) fmt::print("\n{}", groups_text(results, *options.by));
  std::vector<std::pair<std::string, std::string>> links;
  for (const std::string& link : options.links) links.push_back(parse_link(link));
  if (!options.html.empty()) write_file_atomically(options.html, leaderboard_html(results, links));
  if (!options.json.empty()) write_file_atomically(options.json, leaderboard_json(results));
}

}  // namespace

std::pair<std::string, std::string> parse_link(const std::string& text) {
  const std::size_t equals = text.find('=');
  if (equals == std::string::npos || equals == 0 || equals + 1 == text.size())
    throw InputError("--link " + text, "is no link", "write ADDRESS=TEXT, for example leaderboard.html=leaderboard");
  return {text.substr(0, equals), text.substr(equals + 1)};
}

void add_leaderboard(CLI::App& app) {
  auto options = std::make_shared<Options>();
  CLI::App* command = app.add_subcommand("leaderboard", "Rank evaluated agents");
  command->add_option("RESULT", options->results, "Result files written by 'earshot eval --out'")->required();
  static const std::map<std::string, GroupBy> groups{{"novelty", GroupBy::novelty}, {"kind", GroupBy::kind}, {"scene", GroupBy::scene}};
  command->add_option("--by", options->by, "Also a table by novelty of the sound (heard, unheard, unheard kind), its kind, or scene")
      ->transform(CLI::CheckedTransformer(groups, CLI::ignore_case).description("{novelty,kind,scene}"));
  command->add_option("--html", options->html, "Also write a page");
  command->add_option("--link", options->links, "ADDRESS=TEXT of a page that it links to; may be repeated");
  command->add_option("--json", options->json, "Also write the table to a file");
  command->add_flag("--compare", options->compare, "Instead: two results on the same episodes, the first less the second");
  command->add_option("--benchmark", options->benchmark, "Benchmark (configs/benchmarks) by which every result is verified first");
  add_verify_options(*command, options->verify);
  command->callback([options] { run_leaderboard(*options); });
}

}  // namespace earshot
