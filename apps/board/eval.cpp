// SPDX-License-Identifier: Apache-2.0
#include <fmt/format.h>

#include <algorithm>
#include <chrono>
#include <filesystem>
#include <memory>
#include <optional>
#include <set>

#include "apps/board/board_commands.h"
#include "apps/options/output_options.h"
#include "datasets/corpus_parts.h"
#include "evaluation/leaderboard/benchmark.h"
#include "evaluation/leaderboard/board_entry.h"
#include "evaluation/leaderboard/leaderboard.h"
#include "evaluation/leaderboard/private_set.h"
#include "evaluation/results/evaluation_parts.h"
#include "evaluation/results/evaluation_workers.h"
#include "evaluation/results/evaluator.h"
#include "evaluation/results/policy_process.h"
#include "evaluation/results/result_groups.h"
#include "sim/base/control_characters.h"
#include "sim/base/engine_hash.h"
#include "sim/base/files.h"
#include "sim/base/process/closed_pipe.h"
#include "sim/base/process/progress.h"
#include "sim/base/temporary_folder.h"
#include "sim/base/text/log.h"
#include "trainer/checkpoint/checkpoint_bytes.h"
#include "trainer/checkpoint/run_lock.h"
#include "trainer/launch/launcher_job.h"
#include "trainer/run/effective_config.h"
#include "trainer/run/episode_data.h"
#include "trainer/run/field_decision.h"
#include "trainer/run/planned_acoustics.h"

namespace earshot {
namespace {

constexpr const char* kWhat = "earshot eval";

struct EvalArguments {
  std::string agent, config, out, name, benchmark, private_file, track;
  std::vector<std::string> overrides;
  EvaluationConfig evaluation;
  bool argmax = false, sample = false;
  int workers = 1;
  double policy_memory_gb = 4, policy_seconds = 86'400;
  std::string part_folder, json, shard, parts;
};

/// The config's held-out set, unless --episodes names one.
void use_training_set(const RunConfig& config, EvaluationConfig& evaluation) {
  if (!evaluation.episodes.empty()) return;
  evaluation.episodes = config.eval.file;
  evaluation.generator = expected_generator(config.eval, config.env);
}

/// Largest file of a policy that a benchmark takes; that of configs/policies has 2 MB, one of the published sizes 20 MB.
constexpr std::size_t kMaxPolicyBytes = std::size_t{64} << 20;

/// Inputs of an evaluation, for any process that runs it.
struct Plan {
  std::optional<Baseline> baseline;
  CheckpointBytes checkpoint;              ///< unless it is a baseline; as read when the evaluation began
  std::shared_ptr<PolicyProcess> process;  ///< if a benchmark runs a policy
  RunConfig config;
  EvaluationConfig evaluation;
  std::vector<std::string> trained_sounds;
  std::optional<Benchmark> benchmark = {};
};

/// Chooses the acoustics while no other process writes into the folder where they are kept.
RunConfig planned_alone(const RunConfig& config) {
  const auto lock = RunLock::acquire(config.out, kWhat, run_lock_options(launcher_job()));
  return plan_acoustics(config);
}

/// Locks the run folders into which the evaluation writes, for as long as it lives.
std::vector<std::shared_ptr<RunLock>> lock_written_runs(const EvalArguments& options) {
  std::set<std::filesystem::path> folders;
  for (const std::string& file : {options.out, options.json})
    if (const auto folder = file.empty() ? std::nullopt : run_folder_around(file)) folders.insert(*folder);
  std::vector<std::shared_ptr<RunLock>> locks;
  for (const auto& folder : folders) locks.push_back(RunLock::acquire(folder, kWhat, run_lock_options(launcher_job())));
  return locks;
}

/// No result replaces what the evaluation reads, or what a run keeps in its folder.
void check_outputs_of_eval(const EvalArguments& options, const Plan& plan) {
  std::vector<InputPath> inputs{{.option = "the evaluation", .path = plan.evaluation.episodes}};
  if (!plan.baseline) inputs.push_back({.option = "the evaluation", .path = plan.checkpoint.path});
  for (const std::string& file : {options.out, options.json})
    if (const auto folder = file.empty() ? std::nullopt : run_folder_around(file)) {
      const RunFolder run(*folder);
      for (const auto& kept : {run.event_log(), run.curve(), run.lock_file(), run.last_checkpoint(), run.best_checkpoint()})
        inputs.push_back({.option = "the run in " + folder->string(), .path = kept});
      for (const auto& kept : run.checkpoints()) inputs.push_back({.option = "the run in " + folder->string(), .path = kept});
    }
  check_named_outputs({{"--out", options.out}, {"--json", options.json}}, inputs);
}

/// The benchmark that is named, with its set made and the right one; nothing without.
std::optional<Benchmark> benchmark_of(const EvalArguments& options) {
  if (options.benchmark.empty()) {
    if (!options.private_file.empty()) throw InputError("--private", "needs a benchmark", "name the benchmark with --benchmark FILE");
    if (!options.track.empty()) throw InputError("--track", "needs a benchmark", "name the benchmark with --benchmark FILE");
    return std::nullopt;
  }
  if (!options.config.empty() || !options.evaluation.episodes.empty())
    throw InputError("--benchmark", "already sets the rules and the episodes", "leave out --config and --episodes");
  if (!options.track.empty() && options.track != kAnything)
    throw InputError("--track " + options.track, "cannot be asked for: the sensors of a policy decide its track",
                     fmt::format("leave it out, or write --track {} for a policy whose sensors no track has", kAnything));
  Benchmark benchmark = load_benchmark(options.benchmark, options.overrides);
  if (!options.private_file.empty()) benchmark = with_private_set(benchmark, options.private_file);
  static_cast<void>(benchmark_set(benchmark));
  return benchmark;
}

/// The config with the acoustics that are decided once for all who hear by it.
RunConfig with_decided_acoustics(const RunConfig& config) {
  const auto kept = with_kept_acoustics(config, {config.out});
  return decide_field(kept ? *kept : planned_alone(config)).config;
}

/// A network is made before weights are read into it.  The least that its config needs, at two bytes a weight, must be in the file.
void refuse_larger_network(const PolicyConfig& policy, std::size_t bytes, const std::string& where) {
  const auto square = [](int width) { return static_cast<double>(width) * width; };
  const double least = 3 * square(policy.hidden_size) + 2 * square(policy.conv_channels);
  if (2 * least > static_cast<double>(bytes))
    throw InputError(where, fmt::format("is {} bytes, but its network needs at least {:.0f} weights", bytes, least),
                     "export the policy again (earshot policy)");
}

PolicyLimits policy_limits(const EvalArguments& options) {
  require(options.policy_memory_gb > 0 && options.policy_memory_gb <= 1024, "--policy-memory-gb", options.policy_memory_gb,
          "must be in (0, 1024]");
  require(options.policy_seconds >= 1 && options.policy_seconds <= 1e8, "--policy-seconds", options.policy_seconds, "must be in [1, 1e8]");
  PolicyLimits limits;
  limits.memory_bytes = static_cast<std::uint64_t>(options.policy_memory_gb * static_cast<double>(std::uint64_t{1} << 30));
  limits.cpu = std::chrono::seconds(static_cast<std::int64_t>(options.policy_seconds));
  limits.answer = std::min(limits.answer, limits.cpu);
  return limits;
}

/// A policy on a benchmark: the policy chooses network and sensors, the benchmark the settings of the sensors.  Paths in its config are
/// not looked at.
void enter_policy(Plan& plan, const Benchmark& benchmark, const EvalArguments& options) {
  const bool anything = !options.track.empty();
  const std::string where = plan.checkpoint.path.string();
  plan.process = std::make_shared<PolicyProcess>(plan.checkpoint, policy_limits(options));
  if (plan.process->can_open_files() && options.part_folder.empty())
    log_warning("this kernel has no Landlock: the policy's process is limited in memory and time, but could open files");
  const RunConfig policy = config_of_policy(plan.process->config_yaml(), where);
  constexpr std::size_t max_name = 100;
  if (policy.name.size() > max_name)
    throw InputError(where, fmt::format("has a name of {} bytes", policy.name.size()), fmt::format("at most {} are shown", max_name));
  if (has_control_character(policy.name)) throw InputError(where, "has control characters in its name", "ask its author for another file");
  // The sizes in the config are not those of a module, which is made in that process alone.
  if (policy.policy.module.empty()) refuse_larger_network(policy.policy, plan.checkpoint.bytes.size(), where);
  plan.config = with_decided_acoustics(benchmark.run);
  plan.config.name = policy.name;
  plan.config.policy = policy.policy;
  plan.config.eval_actions = policy.eval_actions;
  const std::vector<std::string> changed = changed_in_training(plan.config.env, policy.env);
  if (!changed.empty())
    log_warning(fmt::format("{} was trained with other values of env.{}{}: those of {} {} are used", where, changed.front(),
                            changed.size() > 1 ? fmt::format(" and {} more keys", changed.size() - 1) : "", benchmark.name,
                            benchmark.version));
  plan.config.env = env_for_policy(benchmark, plan.config.env, policy.env, where, anything);
  plan.evaluation.env = plan.config.env;
  if (!plan.evaluation.actions) plan.evaluation.actions = policy.eval_actions;
}

/// worker: that of evaluate_with_workers(), which has the checkpoint; else null.
Plan plan_of(const EvalArguments& options, const EvaluationWorker* worker) {
  if (has_control_character(options.name)) throw InputError("--name", "has control characters", "use letters, digits and signs");
  Plan plan;
  plan.baseline = baseline_by_name(options.agent);
  plan.evaluation = options.evaluation;
  EvaluationConfig& evaluation = plan.evaluation;
  if (plan.baseline && (options.argmax || options.sample))
    throw InputError(options.argmax ? "--argmax" : "--sample", "has no effect on a baseline", "leave it out");
  if (options.argmax) evaluation.actions = ActionChoice::argmax;
  if (options.sample) evaluation.actions = ActionChoice::sample;
  plan.benchmark = benchmark_of(options);
  const std::optional<Benchmark>& benchmark = plan.benchmark;
  if (benchmark) {
    evaluation.episodes = benchmark->run.eval.file;
    evaluation.seed = benchmark->seed;
  }
  if (plan.baseline) {
    const RunConfig config = benchmark                ? benchmark->run
                             : options.config.empty() ? parse_run_config("", "--set", options.overrides)
                                                      : load_run_config(options.config, options.overrides);
    plan.config = with_decided_acoustics(config);  // it hears what the policy of this config does
    use_training_set(plan.config, evaluation);
    if (evaluation.episodes.empty()) throw InputError("--episodes", "is missing", "name an episode set, or a --config that names one");
  } else {
    plan.checkpoint =
        worker != nullptr ? worker->checkpoint() : read_checkpoint(options.agent, benchmark ? kMaxPolicyBytes : kMaxCheckpointBytes);
    if (benchmark) {
      enter_policy(plan, *benchmark, options);
    } else {
      plan.config = config_of_checkpoint(metadata_of(plan.checkpoint), plan.checkpoint.path.string(), options.overrides);
    }
    use_training_set(plan.config, evaluation);
    if (evaluation.episodes.empty())
      throw InputError("--episodes", "is missing, and the checkpoint's config has no data.eval.file", "name an episode set");
  }
  evaluation.num_envs = plan.config.eval_envs;
  plan.trained_sounds =
      expand_sounds(benchmark ? benchmark->run.train.sounds : plan.config.train.sounds);  // before the work: a folder may be gone
  return plan;
}

EvaluationResult evaluate(const Plan& plan, const EvalArguments& options) {
  if (plan.baseline) return evaluate_baseline(*plan.baseline, options.agent, plan.config.env, plan.evaluation);
  if (plan.process) return evaluate_apart(*plan.process, plan.config.name, plan.evaluation);
  return evaluate_checkpoint(plan.checkpoint, plan.evaluation, options.overrides);
}

/// --shard and --parts, which need each other; nothing without.
std::optional<CorpusShard> shard_of(const EvalArguments& options) {
  if (options.shard.empty() != options.parts.empty())
    throw InputError(options.shard.empty() ? "--parts" : "--shard", "needs the other of --shard K/N and --parts FOLDER", "give both");
  if (options.shard.empty()) return std::nullopt;
  if (options.workers > 1) throw InputError("--shard", "cannot be combined with --workers", "leave one of both out");
  if (!options.benchmark.empty())  // whoever writes the whole has not seen all of it run
    throw InputError("--shard", "cannot be combined with --benchmark", "use --workers on one machine");
  return CorpusShard::parse(options.shard);
}

/// An episode must not depend on the load beside it where several processes run parts of a set.
void refuse_stage_limit(const Plan& plan, const char* option, const char* otherwise) {
  if (plan.config.env.stage_limit_s > 0)
    throw InputError(option, "cannot be combined with env.stage_limit_s: the time limit would end other episodes under another load",
                     fmt::format("set env.stage_limit_s=0, or evaluate {}", otherwise));
}

/// All that decides the rows of a part, as lines.
std::string settings_of(const Plan& plan, const EvalArguments& options) {
  const EvaluationConfig& evaluation = plan.evaluation;
  const char* actions = !evaluation.actions ? "of the config" : *evaluation.actions == ActionChoice::argmax ? "argmax" : "sample";
  std::string text = fmt::format("engine: {}\nagent: {}\nbytes: {}\nset: {} {}\nseed: {}\nactions: {}\nepisodes: {}\n", engine_hash(),
                                 options.agent, plan.baseline ? "none" : hex64(hash64(plan.checkpoint.bytes)), evaluation.episodes,
                                 hex64(load_evaluated_set(evaluation)->hash), evaluation.seed, actions, evaluation.max_episodes);
  for (const std::string& override : options.overrides) text += "set: " + override + "\n";
  return text + config_text(plan.config);
}

/// Leaves the part of this process in the folder if it is not there.  The whole once no part is missing, nothing before.
std::optional<EvaluationResult> evaluate_shard(Plan& plan, const EvalArguments& options, const CorpusShard& shard) {
  refuse_stage_limit(plan, "--shard", "without --shard");
  const EvaluationParts parts(options.parts, shard.count, settings_of(plan, options));
  if (!parts.has(shard.index - 1)) {
    const auto set = load_evaluated_set(plan.evaluation);
    EvaluationPart part{.part = shard.index - 1, .parts = shard.count};
    std::size_t mine = 0;
    const int num_envs = evaluation_batch(plan.evaluation, set->episodes.size());
    for (std::size_t episode = 0; episode < set->episodes.size(); ++episode) mine += part.has(episode, num_envs);
    Progress progress("evaluate " + options.agent, "episode", mine);
    part.on_progress = [&](std::size_t done) { progress.update(done); };
    plan.evaluation.part = part;
    parts.save(shard.index - 1, evaluate(plan, options));
  }
  if (const int missing = parts.missing(); missing > 0) {
    fmt::print("{}: {} of {} parts are missing; run any part again when all are in this folder\n", options.parts, missing, shard.count);
    return std::nullopt;
  }
  return parts.join();
}

int run_eval(const EvalArguments& options, const std::vector<std::string>& arguments) {
  outlive_closed_pipes();
  const std::optional<CorpusShard> shard = shard_of(options);
  if (!options.part_folder.empty()) {
    EvaluationWorker worker(options.part_folder, options.agent);
    Plan plan = plan_of(options, &worker);
    worker.prepare(plan.evaluation, load_evaluated_set(plan.evaluation)->episodes.size());
    worker.finish(evaluate(plan, options));
    return 0;
  }
  if (options.workers > 1) static_cast<void>(temporary_parent());  // what is wrong with it is said before the work
  Plan plan = plan_of(options, nullptr);
  check_outputs_of_eval(options, plan);
  std::vector<std::shared_ptr<RunLock>> locks;
  if (!shard) locks = lock_written_runs(options);
  EvaluationResult result;
  if (shard) {
    std::optional<EvaluationResult> whole = evaluate_shard(plan, options, *shard);
    if (!whole) return 0;
    locks = lock_written_runs(options);  // now: the other parts may run at the same time
    result = std::move(*whole);
  } else if (options.workers > 1) {
    refuse_stage_limit(plan, "--workers", "with --workers 1");
    static_cast<void>(load_evaluated_set(plan.evaluation));  // reports its errors once
    int exit_code = 0;
    plan.process.reset();  // each worker has one of its own
    result = evaluate_with_workers(options.workers, arguments, plan.baseline ? nullptr : &plan.checkpoint, exit_code);
    if (exit_code != 0) return exit_code;
  } else {
    result = evaluate(plan, options);
  }
  if (!plan.trained_sounds.empty()) note_novelty(result, plan.trained_sounds);
  result.track = options.track;
  if (!options.name.empty()) result.agent = options.name;
  if (plan.benchmark) {  // whoever runs it has seen it run
    result.standing = standing_of(result, options.agent, *plan.benchmark);
    note_evidence(*result.standing, options.private_file.empty() ? Evidence::run_by_board : Evidence::private_set);
  }
  if (!options.out.empty()) save_result(result, options.out);
  fmt::print("{}", leaderboard_text({result}));
  if (!options.json.empty()) write_file_atomically(options.json, leaderboard_json({result}));
  return 0;
}

}  // namespace

void add_eval(CLI::App& app, const std::vector<std::string>& arguments, int& exit_code) {
  auto options = std::make_shared<EvalArguments>();
  CLI::App* command = app.add_subcommand("eval", "Run an agent on all episodes of a set and report its metrics");
  command->add_option("AGENT", options->agent, "Policy file, checkpoint, run folder, or one of: " + baseline_names())->required();
  command->add_option("--episodes", options->evaluation.episodes, "Episode set (default: data.eval.file of the config)");
  command->add_option("--out", options->out, "Result file to write (JSON)")->type_name(kOutputFile);
  command->add_option("--config", options->config, "Run config with the environment for a baseline");
  command->add_option("--benchmark", options->benchmark,
                      "Benchmark file (see configs/benchmarks); sets the episodes, the seed and a baseline's environment");
  command->add_option("--track", options->track,
                      "With --benchmark: 'anything' also takes a policy whose sensors no track has; it is shown apart from the ranking");
  command->add_option("--private", options->private_file, "Evaluate on the benchmark's private set in this file instead of its test set");
  command->add_option(
      "--set", options->overrides,
      "Override a key of the config: key=value; may be repeated. With --benchmark only folders, threads and sizes of caches");
  command->add_option("--name", options->name, "Agent name in tables (default: name of the config)");
  command->add_option("--seed", options->evaluation.seed, "Seed of sampled actions")->capture_default_str();
  command->add_option("--threads", options->evaluation.threads, "Simulation threads; 0: all cores; the number does not change results")
      ->capture_default_str();
  command->add_option("--max-episodes", options->evaluation.max_episodes, "Run only the first N episodes; 0: all")->capture_default_str();
  auto* argmax = command->add_flag("--argmax", options->argmax, "Take the most probable action (default: eval_actions of the config)");
  command->add_flag("--sample", options->sample, "Sample the action from the policy")->excludes(argmax);
  command
      ->add_option(
          "--workers", options->workers,
          "Worker processes; the number does not change results. They divide the cores of --threads 0, and each has its own scene cache")
      ->capture_default_str()
      ->check(CLI::Range(1, 64));
  command
      ->add_option("--policy-memory-gb", options->policy_memory_gb, "With --benchmark: memory that the process of a policy may take in GB")
      ->capture_default_str();
  command->add_option("--policy-seconds", options->policy_seconds, "With --benchmark: CPU seconds that the process of a policy may take")
      ->capture_default_str();
  command->add_option(
      "--shard", options->shard,
      "K/N: run only part K of N, for N machines, and leave its result in the folder of --parts. The process that finds all "
      "parts there writes the whole: the bytes of one process. Not with --workers, --benchmark or env.stage_limit_s");
  command->add_option("--parts", options->parts, "Folder for the parts of --shard; a part that is there is not run again")
      ->type_name(kOutputFolder);
  command->add_option(kPartFolderOption, options->part_folder)->group("");  // of the workers that --workers starts
  command->add_option("--json", options->json, "Also write the table to this JSON file")->type_name(kOutputFile);
  command->callback([options, &arguments, &exit_code] { exit_code = run_eval(*options, arguments); });
}

}  // namespace earshot
