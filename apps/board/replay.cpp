// SPDX-License-Identifier: Apache-2.0
#include <fmt/format.h>

#include <filesystem>
#include <memory>
#include <optional>

#include "apps/board/board_commands.h"
#include "apps/commands.h"
#include "apps/options/output_options.h"
#include "envs/batch/quarantine_replay.h"
#include "evaluation/leaderboard/benchmark.h"
#include "evaluation/replay/replay_mcap.h"
#include "evaluation/replay/replay_page.h"
#include "evaluation/replay/replay_policy.h"
#include "evaluation/results/set_of_result.h"
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
  fmt::print("replayed    {}\n", outcome.fault ? shown(*outcome.fault, outcome.step) : fmt::format("no fault in {} steps", outcome.step));
  fmt::print("engine      {}\n", outcome.same_engine ? record.engine + ", the same" : record.engine + " (recorded; this build differs)");
  fmt::print("recurs      {}\n", outcome.recurs ? "yes" : "no");
}

/// Sensor settings for the agent: the policy's own config, that of a file, or a benchmark's for baselines.
RunConfig sensing_config(const ReplayArguments& options) {
  if (!options.policy.empty()) {
    const auto checkpoint = find_checkpoint(options.policy);
    return config_of_checkpoint(load_checkpoint_metadata(checkpoint), checkpoint.string(), options.overrides);
  }
  if (!options.benchmark.empty()) {
    RunConfig config = load_benchmark(options.benchmark).run;
    if (!options.overrides.empty())
      throw InputError("--set", "has no effect on a benchmark, whose settings are fixed", "leave it out, or use --config FILE");
    return config;
  }
  const RunConfig config =
      options.config.empty() ? parse_run_config("", "--set", options.overrides) : load_run_config(options.config, options.overrides);
  const auto kept = with_kept_acoustics(config, {config.out});
  return decide_field(kept ? *kept : plan_acoustics(config)).config;
}

void make_page(const ReplayArguments& options) {
  const int named = !options.policy.empty() + !options.config.empty() + !options.benchmark.empty();
  if (named > 1)
    throw InputError("--policy, --config, --benchmark", "exclude each other: each one sets the sensors", "give only one of them");
  const EvaluationResult result = load_result(options.file);
  const std::size_t index = find_episode(result, options.episode);
  if (result.rules.empty())
    throw InputError(options.file, "does not contain its rules: an older version wrote it", "evaluate the agent again");
  ReplayCaption caption{.agent = result.agent, .set_hash = result.set_hash, .engine_hash = result.engine_hash, .policy = {}};
  for (const std::string& link : options.links) caption.links.push_back(parse_link(link));
  RunConfig config = sensing_config(options);
  // What a policy's config names is as little to be trusted as the result.
  const bool is_named = !options.config.empty() || !options.benchmark.empty();
  const std::string file = !options.episodes.empty() ? options.episodes : is_named ? config.eval.file : "";
  const EpisodeSet set = std::filesystem::is_directory(file) ? set_of_result(result, options.file, {file})
                         : file.empty()                      ? set_of_result(result, options.file, folders_near(options.file))
                                                             : load_episode_set(file);
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
      if (!value->empty()) throw InputError(option, "has no effect on a quarantined episode", "leave it out, or add --episode and --html");
    if (!options.links.empty()) throw InputError("--link", "has no effect without --html", "add --episode N and --html FILE");
    return replay_quarantined(options);
  }
  if (options.episode.empty()) throw InputError("--episode", "is missing", "give a number (0 is the first), or best, median or worst");
  if (options.html.empty() && options.mcap.empty()) throw InputError("--html", "is missing", "add --html FILE or --mcap FILE");
  if (options.html.empty() && !options.links.empty()) throw InputError("--link", "has no effect without --html", "add --html FILE");
  make_page(options);
}

}  // namespace

void add_replay(CLI::App& app) {
  auto options = std::make_shared<ReplayArguments>();
  CLI::App* command = app.add_subcommand(
      "replay", "Write an episode of a result as an HTML page with image, map and sound, or re-run a quarantined episode");
  command
      ->add_option("FILE", options->file,
                   "Result file of 'earshot eval --out', or a file from the quarantine folder of a run (env.quarantine_dir)")
      ->required();
  command->add_option("--episode", options->episode, "For a result: episode number (0 is the first), or best, median or worst by SPL");
  command->add_option("--html", options->html, "For a result: HTML page to write, a single file that works offline")
      ->type_name(kOutputFile);
  command->add_option("--mcap", options->mcap, "For a result: MCAP file to write, with pose, images, sound and values of each step")
      ->type_name(kOutputFile);
  command->add_option("--policy", options->policy,
                      "Policy file, checkpoint or run folder; sets the sensors and adds the policy's values and action probabilities");
  command->add_option("--config", options->config, "Run config that sets the sensors, for an agent that is not a policy");
  command->add_option("--benchmark", options->benchmark,
                      "Benchmark file (see configs/benchmarks) that sets the sensors, for an agent that is not a policy");
  command->add_option(
      "--episodes", options->episodes,
      "Episode set, or the folder that holds it (default: data.eval.file of --config or --benchmark, else the file that the result "
      "names, if it lies in the current folder or in that of the result)");
  command->add_option("--link", options->links, "ADDRESS=TEXT: link in the header of the HTML page; may be repeated");
  command->add_option("--set", options->overrides,
                      "Override a key of the policy's config, of --config or of a quarantined episode: key=value. If files have moved: "
                      "env.scene_root=DIR (quarantined episode: scene_root=DIR)");
  command->footer(
      "Result file: runs the recorded actions again with camera and ears. Refuses the result if the numbers differ.\n"
      "Without --policy, --config or --benchmark the default sensors are used.  docs/howto/replay.md describes the page.\n"
      "Quarantined episode: runs the recorded actions with the recorded config and seed, on one thread, up to the recorded step.\n"
      "The last line is `recurs yes` if the same fault occurs at the same step, else `recurs no`.  The exit code is 0 in both cases.");
  command->callback([options] { run_replay(*options); });
}

}  // namespace earshot
