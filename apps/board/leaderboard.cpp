// SPDX-License-Identifier: Apache-2.0
#include "evaluation/leaderboard/leaderboard.h"

#include <fmt/format.h>

#include <algorithm>
#include <filesystem>
#include <map>
#include <memory>
#include <nlohmann/json.hpp>
#include <optional>

#include "apps/board/board_commands.h"
#include "apps/commands.h"
#include "apps/options/output_options.h"
#include "evaluation/leaderboard/benchmark.h"
#include "evaluation/leaderboard/board_entry.h"
#include "evaluation/leaderboard/leaderboard_page.h"
#include "evaluation/leaderboard/paired_comparison.h"
#include "evaluation/leaderboard/private_set.h"
#include "evaluation/results/result_groups.h"
#include "evaluation/results/set_of_result.h"
#include "sim/base/files.h"
#include "sim/base/text/json.h"

namespace earshot {
namespace {

struct LeaderboardArguments {
  std::vector<std::string> results;
  std::string html, json, benchmark, private_file;
  std::vector<std::string> links, replays, private_results, run_here;
  std::optional<GroupBy> by;
  bool compare = false;
  VerifyConfig verify;
};

/// Folder of relative scene files.
std::string scene_root_of(const VerifyConfig& verify, const std::optional<Benchmark>& benchmark) {
  return verify.scene_root.empty() && benchmark ? benchmark->run.env.scene_root : verify.scene_root;
}

struct ReadResults {
  std::vector<EvaluationResult> results;
  EpisodeSet set;  ///< of the benchmark; empty without one
};

/// The results of some files, verified where a benchmark says by what.
ReadResults read_results(const std::vector<std::string>& files, const std::optional<Benchmark>& benchmark, VerifyConfig verify) {
  ReadResults read;
  if (benchmark) {
    read.set = benchmark_set(*benchmark);
    verify.scene_root = scene_root_of(verify, benchmark);
    if (verify.sound_root.empty()) verify.sound_root = benchmark->run.env.sound_root;
  }
  for (const auto& path : files) {
    EvaluationResult result = load_result(path);
    if (!result.partial_of.empty() && !verify.partial)
      throw InputError(path, fmt::format("covers only the first {} episodes of its set", result.episodes.size()),
                       "evaluate the agent without --max-episodes, or add --partial");
    if (!result.matches_checksum)
      throw InputError(path, "was changed after it was written: the checksum does not match",
                       "use the original file of 'earshot eval --out'");
    if (benchmark) {
      result.standing = verify_for_benchmark(result, path, *benchmark, read.set, verify).standing;
      result.verified = true;
    }
    read.results.push_back(std::move(result));
  }
  return read;
}

/// Whether anything is written that tells episodes apart by their scenes' floors and their distances, for which scenes are loaded.
bool needs_places(const LeaderboardArguments& options) {
  return !options.html.empty() || options.by == GroupBy::size || options.by == GroupBy::distance;
}

/// Without a benchmark each result is noted by the file that it names, if that is near and holds its set still: else tables go without.
void note_all_places(ReadResults& read, const std::vector<std::string>& files, const std::string& scene_root, bool is_benchmark) {
  FloorAreas areas(scene_root);
  std::map<std::string, EpisodeSet> sets;  // by hash: a name means another file in another folder
  for (std::size_t i = 0; i < files.size(); ++i) {
    EvaluationResult& result = read.results[i];
    if (is_benchmark) {
      note_places(result, read.set, areas);
      continue;
    }
    try {
      const std::string hash = result.set_hash;
      if (!sets.contains(hash)) sets.emplace(hash, set_of_result(result, files[i], folders_near(files[i])));
      note_places(result, sets.at(hash), areas);
    } catch (const InputError&) {  // the set or its scenes have gone elsewhere
    }
  }
}

/// Throws InputError for the name of an agent without a result.
void require_result_of(const std::string& agent, const std::string& option, const std::vector<EvaluationResult>& results) {
  if (std::ranges::find(results, agent, &EvaluationResult::agent) == results.end())
    throw InputError(option, "names an agent without a result", "use the agent name of one of the result files");
}

/// "AGENT=ADDRESS=TEXT" of --replay.
void add_replay_link(const std::string& text, const std::vector<EvaluationResult>& results, BoardPage& page) {
  const std::size_t equals = text.find('=');
  if (equals == std::string::npos || equals == 0)
    throw InputError("--replay " + text, "is not a link to a replay", "write AGENT=ADDRESS=TEXT, for example greedy=greedy_best.html=best");
  const std::string agent = text.substr(0, equals);
  require_result_of(agent, "--replay " + text, results);
  page.replays[agent].push_back(parse_link(text.substr(equals + 1)));
}

/// A board tells agents apart by their names: that of another must not be borrowed.
void check_names(const std::vector<EvaluationResult>& results, const std::vector<std::string>& files) {
  for (std::size_t i = 0; i < results.size(); ++i)
    for (std::size_t j = 0; j < i; ++j)
      if (results[i].agent == results[j].agent)
        throw InputError(files[i], fmt::format("has the same agent name '{}' as {}", results[i].agent, files[j]),
                         "evaluate one of them again with another --name");
}

/// Evidence for the numbers of each row: maintainers know which policies they have run.
void note_evidence_of_all(std::vector<EvaluationResult>& results, const std::vector<std::string>& run_here,
                          const std::vector<PrivateScore>& hidden) {
  for (EvaluationResult& result : results) {
    if (std::ranges::find(run_here, result.agent) == run_here.end()) {
      note_evidence(*result.standing, Evidence::actions);
      continue;
    }
    const bool on_both = std::ranges::find(hidden, result.agent, &PrivateScore::agent) != hidden.end();
    if (result.senses.empty())
      throw InputError("--run-here " + result.agent, "names a result of an older version, which does not say what the agent sensed",
                       "evaluate the agent again");
    note_evidence(*result.standing, on_both ? Evidence::private_set : Evidence::run_by_board);
  }
}

void check_options(const LeaderboardArguments& options) {
  if (options.compare && options.results.size() != 2) throw InputError("--compare", "needs exactly two results", "give two result files");
  if (options.compare && !options.html.empty())
    throw InputError("--html", "cannot be combined with --compare, which prints no ranking", "give only one of them");
  if (!options.run_here.empty() && options.benchmark.empty())
    throw InputError("--run-here", "has no effect without --benchmark, whose board ranks policies that were run", "add --benchmark FILE");
  for (const auto& [list, option] : {std::pair(&options.links, "--link"), std::pair(&options.replays, "--replay")})
    if (options.html.empty() && !list->empty()) throw InputError(option, "has no effect without --html", "add --html FILE");
  if (options.private_file.empty() != options.private_results.empty())
    throw InputError("--private", "and --private-result need each other", "give both or neither");
  if (!options.private_file.empty() && (options.benchmark.empty() || options.compare))
    throw InputError("--private", "needs a benchmark", "name the benchmark with --benchmark FILE, and leave out --compare");
}

nlohmann::ordered_json json_of(const Estimate& estimate) {
  return {{"mean", estimate.mean}, {"low", estimate.low}, {"high", estimate.high}};
}

nlohmann::ordered_json json_of(const PrivateScore& score) {
  const auto metric = [](const Estimate& open, const Estimate& hidden, const Estimate& gap) {
    return nlohmann::ordered_json{{"public", json_of(open)}, {"private", json_of(hidden)}, {"gap", json_of(gap)}};
  };
  return {{"agent", score.agent},
          {"success", metric(score.public_success, score.private_success, score.success_gap)},
          {"spl", metric(score.public_spl, score.private_spl, score.spl_gap)},
          {"unexplained", score.unexplained()}};
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
  return json_text(json, 2) + "\n";
}

void run_leaderboard(const LeaderboardArguments& options) {
  check_options(options);
  std::optional<Benchmark> benchmark;
  if (!options.benchmark.empty()) benchmark = load_benchmark(options.benchmark);
  check_named_outputs({{"--html", options.html}, {"--json", options.json}}, benchmark ? sets_of(*benchmark) : std::vector<InputPath>{});
  ReadResults read = read_results(options.results, benchmark, options.verify);
  std::vector<EvaluationResult>& results = read.results;
  if (options.compare) {
    fmt::print("{}", comparison_text(results[0], results[1]));
    if (!options.json.empty()) write_file_atomically(options.json, comparison_json(results[0], results[1]));
    return;
  }
  if (benchmark) check_names(results, options.results);
  BoardPage page;
  for (const std::string& link : options.links) page.links.push_back(parse_link(link));
  for (const std::string& replay : options.replays) add_replay_link(replay, results, page);
  for (const std::string& agent : options.run_here) require_result_of(agent, "--run-here " + agent, results);
  if (!options.private_file.empty())
    page.private_scores = private_scores(
        results, read_results(options.private_results, with_private_set(*benchmark, options.private_file), options.verify).results);
  if (benchmark) page.benchmark = fmt::format("{} {}", benchmark->name, benchmark->version);
  if (benchmark) note_evidence_of_all(results, options.run_here, page.private_scores);
  if (needs_places(options)) note_all_places(read, options.results, scene_root_of(options.verify, benchmark), benchmark.has_value());
  const std::string groups = options.by ? groups_text(results, *options.by) : "";  // refused before anything is written

  fmt::print("{}", leaderboard_text(results));
  if (!benchmark) fmt::print("not verified: numbers as stored in the files ('earshot verify' or --benchmark checks them)\n");
  if (!page.private_scores.empty()) fmt::print("\n{}", private_text(page.private_scores));
  if (options.by) fmt::print("\n{}", groups);
  if (!options.html.empty()) write_file_atomically(options.html, leaderboard_page(results, page));
  if (options.json.empty()) return;
  auto json = parse_ordered_json(leaderboard_json(results));
  for (const PrivateScore& score : page.private_scores) json["private"].push_back(json_of(score));
  if (options.by)
    for (const EvaluationResult& result : results)
      for (const auto& [name, group] : groups_of(result, *options.by))
        json["groups"].push_back({{"agent", result.agent},
                                  {"group", name},
                                  {"episodes", group.episodes.size()},
                                  {"success", json_of(group.success())},
                                  {"success_when_silent", json_of(group.success_when_silent())},
                                  {"spl", json_of(group.spl())}});
  write_file_atomically(options.json, json_text(json, 2) + "\n");
}

}  // namespace

std::pair<std::string, std::string> parse_link(const std::string& text) {
  const std::size_t equals = text.find('=');
  if (equals == std::string::npos || equals == 0 || equals + 1 == text.size())
    throw InputError("--link " + text, "is not a link", "write ADDRESS=TEXT, for example leaderboard.html=leaderboard");
  return {text.substr(0, equals), text.substr(equals + 1)};
}

void add_leaderboard(CLI::App& app) {
  auto options = std::make_shared<LeaderboardArguments>();
  CLI::App* command = app.add_subcommand("leaderboard", "Rank evaluated agents");
  command->add_option("RESULT", options->results, "Result files written by 'earshot eval --out'")->required();
  static const std::map<std::string, GroupBy> groups{{"novelty", GroupBy::novelty},
                                                     {"kind", GroupBy::kind},
                                                     {"size", GroupBy::size},
                                                     {"distance", GroupBy::distance},
                                                     {"scene", GroupBy::scene}};
  command
      ->add_option("--by", options->by,
                   "Also print a table grouped by novelty of the sound (heard, unheard, unheard kind), kind of sound, size of the scene, "
                   "distance to the goal, or scene")
      ->transform(CLI::CheckedTransformer(groups, CLI::ignore_case).description("{novelty,kind,size,distance,scene}"));
  command->add_option("--html", options->html, "Also write the table as an HTML page")->type_name(kOutputFile);
  command->add_option("--link", options->links, "ADDRESS=TEXT: link on the HTML page; may be repeated");
  command->add_option("--replay", options->replays, "AGENT=ADDRESS=TEXT: link to a replay on the HTML page; may be repeated")
      ->allow_extra_args(false);
  command
      ->add_option(
          "--run-here", options->run_here,
          "With --benchmark: agent whose policy you ran yourself. All others rest on their actions alone and get no rank; may be repeated")
      ->allow_extra_args(false);
  command->add_option("--private", options->private_file, "File with the benchmark's private set, used for --private-result");
  command->add_option("--private-result", options->private_results, "Result file of one of the agents on the private set; may be repeated")
      ->allow_extra_args(false);
  command->add_option("--json", options->json, "Also write the table to this JSON file")->type_name(kOutputFile);
  command->add_flag("--compare", options->compare, "Instead: compare two results on the same episodes (first minus second)");
  command->add_option("--benchmark", options->benchmark,
                      "Benchmark file (see configs/benchmarks); every result is verified against it first");
  add_verify_options(*command, options->verify);
  command->callback([options] { run_leaderboard(*options); });
}

}  // namespace earshot
