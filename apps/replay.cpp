#include <fmt/format.h>

#include <memory>

#include "apps/commands.h"
#include "envs/quarantine_replay.h"

namespace earshot {
namespace {

struct Options {
  std::string file;
  std::vector<std::string> overrides;
};

std::string shown(const FaultReport& report, int step) {
  return fmt::format("{} at step {}: {}", name_of(report.fault), step, report.detail);
}

void run_replay(const Options& options) {
  const QuarantineRecord record = load_quarantine_record(options.file);
  fmt::print("episode     '{}' in {}, env {}, seed {}\n", record.episode.episode_id, record.episode.scene_id, record.env, record.seed);
  fmt::print("recorded    {}\n", shown(record.report, record.step));
  const ReplayOutcome outcome = replay(record, options.overrides);
  fmt::print("now         {}\n", outcome.fault ? shown(*outcome.fault, outcome.step) : fmt::format("no fault in {} steps", outcome.step));
  fmt::print("engine      {}\n", outcome.same_engine ? record.engine + ", the same" : record.engine + " then, another one now");
  fmt::print("recurs      {}\n", outcome.recurs ? "yes" : "no");
}

}  // namespace

void add_replay(CLI::App& app) {
  auto options = std::make_shared<Options>();
  CLI::App* command = app.add_subcommand("replay", "Run a quarantined episode again and say whether its fault recurs");
  command->add_option("FILE", options->file, "File that a run wrote to its quarantine_dir (env.quarantine_dir of a run config)")
      ->required();
  command->add_option(
      "--set", options->overrides,
      "key=value over the recorded environment config, for example scene_root=DIR or sound_root=DIR where files have moved");
  command->footer(
      "Runs the recorded actions with the recorded config and seed, on one thread, up to the recorded step. The last line says `recurs "
      "yes`\n"
      "if the same fault is found at the same step, else `recurs no`; either way the exit code is 0.");
  command->callback([options] { run_replay(*options); });
}

}  // namespace earshot
