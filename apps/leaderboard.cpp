#include "trainer/leaderboard.h"

#include <fmt/format.h>

#include <map>
#include <memory>
#include <optional>

#include "apps/commands.h"
#include "sim/base/files.h"
#include "trainer/result_groups.h"

namespace earshot {
namespace {

struct Options {
  std::vector<std::string> results;
  std::string html;
  std::optional<GroupBy> by;
};

void run_leaderboard(const Options& options) {
  std::vector<EvaluationResult> results;
  for (const auto& path : options.results) results.push_back(load_result(path));
  fmt::print("{}", leaderboard_text(results));
  if (options.by) fmt::print("\n{}", groups_text(results, *options.by));
  if (!options.html.empty()) write_file_atomically(options.html, leaderboard_html(results));
}

}  // namespace

void add_leaderboard(CLI::App& app) {
  auto options = std::make_shared<Options>();
  CLI::App* command = app.add_subcommand("leaderboard", "Rank evaluated agents");
  command->add_option("RESULT", options->results, "Result files written by 'earshot eval --out'")->required();
  static const std::map<std::string, GroupBy> groups{{"novelty", GroupBy::novelty}, {"kind", GroupBy::kind}, {"scene", GroupBy::scene}};
  command->add_option("--by", options->by, "Also a table by novelty of the sound (heard, unheard, unheard kind), its kind, or scene")
      ->transform(CLI::CheckedTransformer(groups, CLI::ignore_case).description("{novelty,kind,scene}"));
  command->add_option("--html", options->html, "Also write a page");
  command->callback([options] { run_leaderboard(*options); });
}

}  // namespace earshot
