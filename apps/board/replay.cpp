#include <fmt/format.h>

#include <filesystem>
#include <memory>
#include <optional>

#include "apps/board/board_commands.h"
#include "apps/commands.h"
#include "envs/batch/quarantine_replay.h"
#include "evaluation/leaderboard/benchmark.h"
#include "evaluation/replay/replay_mcap.h"
#include "evaluation/replay/replay_page.h"
#include "evaluation/replay/replay_policy.h"
#include "sim/base/errors.h"
#include "sim/base/files.h"
#include "trainer/checkpoint/find_checkpoint.h"
#include "trainer/run/effective_config.h"
#include "trainer/run/field_decision.h"
#include "trainer/run/planned_acoustics.h"

namespace earshot {
namespace {

struct ReplayArguments {
  std::string file, episode, html, mcap, policy, config, benchmark, episodes;
  std::vector<std::string> overrides, links;
};

std::string shown(const FaultReport& report, int step) {
  return fmt::format("{} at step {}: {}", name_of(report.fault), step, report.detail);
}

void replay_quarantined(const ReplayArguments& options) {
  const QuarantineRecord record = load_quarantine_record(options.file);
  fmt::print("episode     '{}' in {}, env {}, seed {}\n", record.episode.episode_id, record.episode.scene_id, record.env, record.seed);
  fmt::print("recorded    {}\n", shown(record.report, record.step));
  const ReplayOutcome outcome = replay(record, options.overrides);
  fmt::print("now         {}\n", outcome.fault ? shown(*outcome.fault, outcome.step) : fmt::format("no fault in {} steps", outcome.step));
  fmt::print("engine      {}\n", outcome.same_engine ? record.engine + ", the same" : record.engine + " then, another one now");
  fmt::print("recurs      {}\n", outcome.recurs ? "yes" : "no");
}

/// What the agent is to see and hear by: the policy's own config, that of a file, or a benchmark's for baselines.
RunConfig sensing_config(const ReplayArguments& options) {
  if (!options.policy.empty()) {
    const auto checkpoint = find_checkpoint(options.policy);
    return parse_effective_config(load_checkpoint_metadata(checkpoint).config_yaml, checkpoint.string() + " (its config)",
                                  options.overrides);
  }
  if (!options.benchmark.empty()) {
    RunConfig config = load_benchmark(options.benchmark).run;
    if (!options.overrides.empty())
      throw InputError("--set", "has no effect on a benchmark, which is fixed", "leave it out, or name a --config");
    return config;
  }
  const RunConfig config =
      options.config.empty() ? parse_run_config("", "--set", options.overrides) : load_run_config(options.config, options.overrides);
  const auto kept = with_kept_acoustics(config, {config.out});
  return decide_field(kept ? *kept : plan_acoustics(config)).config;
}

void make_page(const ReplayArguments& options) {
  const int named = !options.policy.empty() + !options.config.empty() + !options.benchmark.empty();
  if (named > 1) throw InputError("--policy, --config, --benchmark", "each say what the agent senses", "name one of them");
  const EvaluationResult result = load_result(options.file);
  const std::size_t index = find_episode(result, options.episode);
  if (result.rules.empty())
    throw InputError(options.file, "does not say by which rules it was run: it is older than that", "evaluate the agent again");
  ReplayCaption caption{.agent = result.agent, .set_hash = result.set_hash, .engine_hash = result.engine_hash, .policy = {}};
  for (const std::string& link : options.links) caption.links.push_back(parse_link(link));
  const EpisodeSet set = load_episode_set(options.episodes.empty() ? result.episodes_file : options.episodes);
  RunConfig config = sensing_config(options);
  PolicyObserver observer;
  if (!options.policy.empty()) {
    config.env.observation.goal_state = config.policy.guided_critic;  // its critic reads it, its actor does not
    observer = observe_with_policy(find_checkpoint(options.policy), config);
    caption.policy = config.name;
  }
  const EpisodeRecording recording = record_episode(result, options.file, set, index, config.env, {}, observer);
  if (!options.mcap.empty()) {
    const std::string bytes = replay_mcap(recording);
    write_file_atomically(options.mcap, bytes);
    fmt::print("{}: {} observations; {:.1f} MB\n", options.mcap, recording.steps.size(), static_cast<double>(bytes.size()) * 1e-6);
  }
  if (options.html.empty()) return;
  const std::string page = replay_html(recording, caption);
  write_file_atomically(options.html, page);
  fmt::print("{}: episode {} ('{}' in {}), {} actions, SPL {:.3f}; {:.1f} MB{}\n", options.html, index, recording.episode.episode_id,
             recording.episode.scene_id, recording.actions.size(), recording.metrics.spl, static_cast<double>(page.size()) * 1e-6,
             replay_has_three() ? "" : "; without the house: this program was built without three.js (apt-get install libjs-three)");
}

void run_replay(const ReplayArguments& options) {
  const bool page = !options.html.empty() || !options.mcap.empty() || !options.episode.empty();
  if (!page) {
    for (const auto& [value, option] : {std::pair(&options.policy, "--policy"), std::pair(&options.config, "--config"),
                                        std::pair(&options.benchmark, "--benchmark"), std::pair(&options.episodes, "--episodes")})
      if (!value->empty()) throw InputError(option, "has no effect on a quarantined episode", "leave it out, or say --episode and --html");
    if (!options.links.empty()) throw InputError("--link", "has no effect without a page", "say --episode and --html");
    return replay_quarantined(options);
  }
  if (options.episode.empty()) throw InputError("--episode", "is missing", "say which one: a number from 0 on, or best, median or worst");
  if (options.html.empty() && options.mcap.empty())
    throw InputError("--html", "is missing", "name the page to write, or a file with --mcap");
  if (options.html.empty() && !options.links.empty()) throw InputError("--link", "has no effect without a page", "say --html");
  make_page(options);
}

}  // namespace

void add_replay(CLI::App& app) {
  auto options = std::make_shared<ReplayArguments>();
  CLI::App* command =
      app.add_subcommand("replay", "Show an episode of a result as a page with picture, map and sound, or run a quarantined one again");
  command
      ->add_option(
          "FILE", options->file,
          "Result file of 'earshot eval --out'; or a file that a run wrote to its quarantine_dir (env.quarantine_dir of a run config)")
      ->required();
  command->add_option("--episode", options->episode, "Of a result: its number from 0 on, or best, median or worst by SPL");
  command->add_option("--html", options->html, "Of a result: the page to write, one file that needs no network");
  command->add_option("--mcap", options->mcap, "Of a result: an MCAP file to write, with pose, pictures, sound and numbers of each step");
  command->add_option("--policy", options->policy,
                      "Policy file, checkpoint or run folder: what the agent sees and hears, and its values and probabilities");
  command->add_option("--config", options->config, "Run config: what the agent sees and hears, where it is no policy");
  command->add_option("--benchmark", options->benchmark, "Benchmark (configs/benchmarks): the same");
  command->add_option("--episodes", options->episodes, "Episode set (default: the file that the result names)");
  command->add_option("--link", options->links, "ADDRESS=TEXT of another page, for the head of this one; may be repeated");
  command->add_option(
      "--set", options->overrides,
      "key=value over the config: that of the policy or --config, or the recorded one of a quarantined episode; for example "
      "env.scene_root=DIR (quarantined: scene_root=DIR) where files have moved");
  command->footer(
      "A page: the recorded actions are walked again, with eyes and ears, and refused if their numbers are not those of the result.\n"
      "Without --policy, --config or --benchmark the agent senses by the defaults.  docs/howto/replay.md says what the page shows.\n"
      "A quarantined episode: runs the recorded actions with the recorded config and seed, on one thread, up to the recorded step. The "
      "last\n"
      "line says `recurs yes` if the same fault is found at the same step, else `recurs no`; either way the exit code is 0.");
  command->callback([options] { run_replay(*options); });
}

}  // namespace earshot
