#include "trainer/leaderboard.h"

#include <fmt/format.h>

#include <memory>

#include "apps/commands.h"
#include "sim/base/files.h"

namespace earshot {
namespace {

struct Options {
  std::vector<std::string> results;
  std::string html;
};

void run_leaderboard(const Options& options) {
  std::vector<EvaluationResult> results;
  for (const auto& path : options.results) results.push_back(load_result(path));
  fmt::print("{}", leaderboard_text(results));
  if (!options.html.empty()) write_file_atomically(options.html, leaderboard_html(results));
}

}  // namespace

void add_leaderboard(CLI::App& app) {
  auto options = std::make_shared<Options>();
  CLI::App* command = app.add_subcommand("leaderboard", "Rank evaluated agents");
  command->add_option("RESULT", options->results, "Result files written by 'earshot eval --out'")->required();
  command->add_option("--html", options->html, "Also write a page");
  command->callback([options] { run_leaderboard(*options); });
}

}  // namespace earshot
