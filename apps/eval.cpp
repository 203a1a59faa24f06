#include <fmt/format.h>

#include <memory>

#include "apps/commands.h"
#include "trainer/benchmark.h"
#include "trainer/effective_config.h"
#include "trainer/episode_data.h"
#include "trainer/evaluator.h"
#include "trainer/field_decision.h"
#include "trainer/find_checkpoint.h"
#include "trainer/leaderboard.h"
#include "trainer/planned_acoustics.h"
#include "trainer/result_groups.h"

namespace earshot {
namespace {

struct Options {
  std::string agent, config, out, name, benchmark;
  std::vector<std::string> overrides;
  EvaluationConfig evaluation;
  bool argmax = false, sample = false;
};

/// The config's held-out set, unless --episodes names one.
void take_set_of(const RunConfig& config, EvaluationConfig& evaluation) {
  if (!evaluation.episodes.empty()) return;
  evaluation.episodes = config.eval.file;
  evaluation.generator = expected_generator(config.eval, config.env);
}

void run_eval(const Options& options) {
  EvaluationConfig evaluation = options.evaluation;
  const auto baseline = baseline_by_name(options.agent);
  if (baseline && (options.argmax || options.sample))
    throw InputError(options.argmax ? "--argmax" : "--sample", "has no effect on a baseline", "leave it out");
  if (options.argmax) evaluation.actions = ActionChoice::argmax;
  if (options.sample) evaluation.actions = ActionChoice::sample;
  std::optional<Benchmark> benchmark;
  if (!options.benchmark.empty()) {
    if (!options.config.empty() || !evaluation.episodes.empty())
      throw InputError("--benchmark", "names rules and episodes itself", "leave out --config and --episodes");
    benchmark = load_benchmark(options.benchmark);
    static_cast<void>(benchmark_set(*benchmark));  // made where it is missing, and the right one
    evaluation.episodes = benchmark->run.eval.file;
    evaluation.seed = benchmark->seed;
  }
  EvaluationResult result;
  std::vector<std::string> trained_sounds;
  if (baseline) {
    RunConfig config = benchmark                ? benchmark->run
                       : options.config.empty() ? parse_run_config("", "--set", options.overrides)
                                                : load_run_config(options.config, options.overrides);
    const auto kept = with_kept_acoustics(config, {config.out});
    config = decide_field(kept ? *kept : plan_acoustics(config)).config;  // it hears what the policy of this config does
    take_set_of(config, evaluation);
    if (evaluation.episodes.empty()) throw InputError("--episodes", "is missing", "name an episode set, or a --config that names one");
    evaluation.num_envs = config.eval_envs;
    trained_sounds = expand_sounds(config.train.sounds);  // before the work: a folder may be gone
    result = evaluate_baseline(*baseline, options.agent, config.env, evaluation);
  } else {
    const auto checkpoint = find_checkpoint(options.agent);
    const RunConfig config =
        parse_effective_config(load_checkpoint_metadata(checkpoint).config_yaml, checkpoint.string() + " (its config)", options.overrides);
    take_set_of(config, evaluation);
    if (evaluation.episodes.empty())
      throw InputError("--episodes", "is missing and the checkpoint's config names none", "name an episode set");
    evaluation.num_envs = config.eval_envs;
    trained_sounds = expand_sounds(config.train.sounds);  // before the work: a folder may be gone
    result = evaluate_checkpoint(checkpoint, evaluation, options.overrides);
  }
  if (benchmark) trained_sounds = expand_sounds(benchmark->run.train.sounds);
  if (!trained_sounds.empty()) note_novelty(result, trained_sounds);
  if (!options.name.empty()) result.agent = options.name;
  if (!options.out.empty()) save_result(result, options.out);
  fmt::print("{}", leaderboard_text({result}));
}

}  // namespace

void add_eval(CLI::App& app) {
  auto options = std::make_shared<Options>();
  CLI::App* command = app.add_subcommand("eval", "Run an agent on every episode of a set and report its metrics");
  command->add_option("AGENT", options->agent, "Checkpoint, run folder, or one of: " + baseline_names())->required();
  command->add_option("--episodes", options->evaluation.episodes, "Episode set (default: data.eval.file of the config)");
  command->add_option("--out", options->out, "Result file (JSON) to write");
  command->add_option("--config", options->config, "Run config that fixes the environment of a baseline");
  command->add_option("--benchmark", options->benchmark,
                      "Benchmark (configs/benchmarks): its test set and seed, and a baseline's environment");
  command->add_option("--set", options->overrides, "key=value over the config");
  command->add_option("--name", options->name, "Name in tables (default: the config's name)");
  command->add_option("--seed", options->evaluation.seed, "Seed of sampled actions")->capture_default_str();
  command->add_option("--threads", options->evaluation.threads, "Simulation threads; 0: all cores; any number gives the same bits")
      ->capture_default_str();
  command->add_option("--max-episodes", options->evaluation.max_episodes, "Only the first N episodes; 0: all")->capture_default_str();
  auto* argmax = command->add_flag("--argmax", options->argmax, "Most probable action (default: eval_actions of the config)");
  command->add_flag("--sample", options->sample, "Action drawn from the policy's distribution")->excludes(argmax);
  command->callback([options] { run_eval(*options); });
}

}  // namespace earshot
