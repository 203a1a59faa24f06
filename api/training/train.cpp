// SPDX-License-Identifier: Apache-2.0
#include "earshot/train.h"

#include "evaluation/results/evaluator.h"
#include "evaluation/results/held_out_check.h"
#include "evaluation/results/held_out_evaluation.h"
#include "sim/base/errors.h"
#include "trainer/checkpoint/find_checkpoint.h"
#include "trainer/checkpoint/run_folder.h"
#include "trainer/collective/collective.h"
#include "trainer/run/effective_config.h"
#include "trainer/run/episode_data.h"
#include "trainer/run/field_decision.h"
#include "trainer/run/planned_acoustics.h"
#include "trainer/run/start_run.h"
#include "trainer/run/train_loop.h"

namespace earshot::api {
namespace {

RunConfig read_run(const Config& run) { return parse_run_config(run.yaml, run.where, run.overrides.texts()); }

/// With the choice that env.accuracy asks for: the one that the run has kept, or one that is made here.
RunConfig with_acoustics(const RunConfig& config, const RunStart& start) {
  std::vector<std::filesystem::path> folders = {config.out};
  if (!start.resume.empty()) folders.push_back(run_folder_of(start.resume));
  if (auto kept = with_kept_acoustics(config, folders)) return *kept;
  if (!start.resume.empty())
    throw InputError("env.accuracy " + config.env.accuracy, "was not planned by the run to go on with, or for another config",
                     "copy its " + acoustics_plan_file(config, {}).string() + " to " + config.out + ", or start a new run");
  refuse_mixed_runs(config, start);
  refuse_stale_episodes(config, start);
  return plan_acoustics(config);
}

EvaluationConfig evaluation_config(const RunConfig& config, const EvaluateOptions& options) {
  EvaluationConfig evaluation;
  evaluation.episodes = options.episodes.string();
  if (evaluation.episodes.empty()) {
    evaluation.episodes = config.eval.file;
    evaluation.generator = expected_generator(config.eval, config.env);
  }
  if (evaluation.episodes.empty()) throw InputError("episodes", "is missing and the config names none", "name an episode set");
  evaluation.num_envs = config.eval_envs;
  evaluation.max_episodes = options.max_episodes;
  evaluation.threads = options.threads;
  evaluation.seed = options.seed;
  return evaluation;
}

std::vector<Estimate> report(const EvaluationResult& result, const EvaluateOptions& options) {
  if (!options.out.empty()) save_result(result, options.out);
  std::vector<Estimate> estimates;
  for (const auto& [name, estimate] : result.summary()) estimates.push_back({name, estimate.mean, estimate.low, estimate.high});
  return estimates;
}

}  // namespace

std::string run_config_text(const Config& run) { return earshot::config_text(read_run(run)); }

std::pair<std::size_t, std::size_t> write_episode_sets(const Config& run) {
  const RunConfig config = read_run(run);
  const std::size_t train = generate_data(config.train, config.env).episodes.size();
  const std::size_t eval = generate_data(config.eval, config.env).episodes.size();
  if (!config.held_out_data.file.empty()) (void)generate_data(config.held_out_data, config.env);
  return {train, eval};
}

TrainReport train(const Config& run, const TrainOptions& options) {
  const RunConfig asked = read_run(run);
  if (asked.train.file.empty()) throw InputError(run.where, "names no data.train.file", "add it, and call write_episode_sets()");
  if (!std::filesystem::exists(asked.train.file))
    throw InputError(asked.train.file, "no such episode set", "write it with write_episode_sets()");
  RunStart start;
  if (!options.resume.empty()) start.resume = find_checkpoint(options.resume);
  start.overwrite = options.overwrite;
  start.changes = options.changes;
  start.remake = "write_episode_sets()";
  const FieldDecision decided = decide_field(with_acoustics(asked, start), start.resume);
  start.note = decided.text;
  check_held_out(decided.config, "write_episode_sets()", HeldOutCheck::all);
  const std::unique_ptr<HeldOutEvaluator> held_out = make_held_out_evaluator(decided.config);
  const std::unique_ptr<Collective> worker = make_single_worker();
  const earshot::TrainReport report = earshot::train(decided.config, *worker, start, {.held_out = held_out.get()});
  return {report.updates, report.env_steps, report.wall_s, report.steps_per_s, report.checkpoint};
}

std::vector<Estimate> evaluate(const std::filesystem::path& agent, const EvaluateOptions& options, const Settings& overrides) {
  const std::filesystem::path checkpoint = find_checkpoint(agent);
  const RunConfig config =
      parse_effective_config(load_checkpoint_metadata(checkpoint).config_yaml, checkpoint.string() + " (its config)", overrides.texts());
  return report(evaluate_checkpoint(checkpoint, evaluation_config(config, options), overrides.texts()), options);
}

std::vector<Estimate> evaluate_baseline(const std::string& name, const Config& run, const EvaluateOptions& options) {
  const auto baseline = baseline_by_name(name);
  if (!baseline) throw InputError(name, "is no baseline", "take one of: " + baseline_names());
  const RunConfig asked = read_run(run);
  const auto kept = with_kept_acoustics(asked, {asked.out});
  const RunConfig config = decide_field(kept ? *kept : plan_acoustics(asked)).config;  // it hears what the policy of this config does
  return report(earshot::evaluate_baseline(*baseline, name, config.env, evaluation_config(config, options)), options);
}

}  // namespace earshot::api
