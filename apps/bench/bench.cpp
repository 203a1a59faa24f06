// SPDX-License-Identifier: Apache-2.0
#include <fmt/format.h>

#include <cstdio>
#include <memory>
#include <optional>
#include <string>
#include <tuple>
#include <utility>
#include <vector>

#include "apps/commands.h"
#include "apps/options/output_options.h"
#include "apps/options/picture_size.h"
#include "apps/options/scene_options.h"
#include "bench/accuracy/accuracy_promise.h"
#include "bench/accuracy/accuracy_report.h"
#include "bench/accuracy/engine_comparison.h"
#include "bench/soak/report.h"
#include "bench/speed/bench_env.h"
#include "bench/speed/bench_rir.h"
#include "bench/speed/hearing_cost.h"
#include "bench/speed/scene_scale.h"
#include "sim/base/errors.h"
#include "sim/base/temporary_folder.h"

namespace earshot {
namespace {

struct BenchArguments {
  std::string json;
  bool quick = false;
};

void finish(const BenchReport& report, const BenchArguments& options) {
  fmt::print("\n{}", report.table());
  report.write(options.json);
}

struct RirCommand : BenchArguments {
  std::vector<std::string> scenes;
  AxesOptions axes;
  std::optional<double> reference_seconds;
  std::optional<int> reference_poses;
};

struct AccuracyCommand : BenchArguments {
  std::string out = "accuracy";
  std::optional<double> minutes;
  std::vector<std::string> engines;
};

void run_accuracy(const AccuracyCommand& command) {
  AccuracyOptions options;
  options.quick = command.quick;
  options.minutes = command.minutes.value_or(command.quick ? 2.5 : 20);
  require(options.minutes > 0 && options.minutes <= 1440, "--minutes", options.minutes, "must be in (0, 1440]");
  static_cast<void>(temporary_parent());  // for requests to other engines
  for (const std::string& engine : command.engines) options.engines.push_back(EngineCommand::parse(engine));
  if (command.engines.empty()) options.engines = usual_engines();
  options.after_scene = [&](const AccuracyStudy& so_far) { write_accuracy_files(so_far, command.out); };
  const AccuracyStudy study = run_accuracy_study(options);
  fmt::print(
      "{}: accuracy.csv, accuracy_tables.md, accuracy_pareto.svg, accuracy_scenes.svg, accuracy_sweeps.svg, "
      "accuracy_engines.svg\n",
      command.out);
  for (const std::string& line : study.engines.left_out) fmt::print("{}\n", line);
  finish(accuracy_bench_report(study), command);
}

struct PromiseCommand : BenchArguments {
  std::vector<std::string> scenes, targets;
  AxesOptions axes;
};

void run_promise(const PromiseCommand& command) {
  PromiseOptions options{.quick = command.quick, .scenes = command.axes.applied_to(command.scenes), .targets = command.targets};
  const std::vector<PromiseScene> scenes =
      run_promises(options, [](const PromiseScene& scene) { fmt::print("{}\n", promises_markdown({scene})), std::fflush(stdout); });
  fmt::print("\n{}", promises_markdown(scenes));
  promises_report(scenes).write(command.json);
}

struct SoakCommand {
  SoakOptions options;
  std::string json, out;
};

void run_soak_command(const SoakCommand& command) {
  static_cast<void>(temporary_parent());  // for scenes that are files
  SoakOptions options = command.options;
  if (!command.out.empty()) options.on_progress = [&](const SoakResult& so_far) { write_soak_files(so_far, command.out); };
  const SoakResult result = run_soak(options);
  if (!command.out.empty()) write_soak_files(result, command.out);
  soak_bench_report(result).write(command.json);
  fmt::print("{}", soak_markdown(result));
  if (!result.passed()) throw RunError("bench soak", "a bound was exceeded: see the bounds above");
}

void add_soak(CLI::App& bench) {
  const auto soak = std::make_shared<SoakCommand>();
  SoakOptions& options = soak->options;
  CLI::App* command = bench.add_subcommand("soak",
                                           "Soak test: step a batch through generated scenes for a long time and check observations, "
                                           "energy, memory and step times; exit code 1 if a bound is exceeded");
  command->add_option("--steps", options.steps, "Agent steps to run")->capture_default_str();
  command->add_option("--scenes", options.scenes, "Number of generated scenes (houses and shoeboxes)")->capture_default_str();
  command
      ->add_option("--hard-every", options.hard_every,
                   "Make every N-th scene a hard case (tiny, rigid, open, far from the origin and others); 0: no hard cases")
      ->capture_default_str();
  command->add_option("--num-envs", options.num_envs, "Number of environments in the batch")->capture_default_str();
  command->add_option("--threads", options.threads, "Threads for the batch; 0: all cores")->capture_default_str();
  command->add_option("--minutes", options.minutes, "Time limit in minutes; the run stops when it is reached")->capture_default_str();
  command->add_option("--seed", options.seed, "Seed of scenes, episodes and actions")->capture_default_str();
  command
      ->add_option("--camera-px", options.camera_px, "Image width and height in pixels; keep it small so that rendering does not dominate")
      ->capture_default_str();
  command
      ->add_option("--cache-mb", options.cache_mb,
                   "Size limit of the scene cache in MiB; choose it below the total size of the scenes so that the cache evicts")
      ->capture_default_str();
  command->add_option("--replays", options.replays, "Number of episodes to replay at the end, one at a time; each must reproduce its bits")
      ->capture_default_str();
  command->add_option("--memory-limit", options.memory_limit_mib, "Allowed growth of resident memory in MiB per 100000 steps")
      ->capture_default_str();
  command->add_option("--out", soak->out, "Folder for soak.md, soak.json and soak.svg, updated during the run")->type_name(kOutputFolder);
  command->add_option("--json", soak->json, "Also write names, values and settings to this JSON file")->type_name(kOutputFile);
  command->callback([soak] { run_soak_command(*soak); });
}

struct ScenesCommand {
  SceneScaleOptions options;
  std::string store, json;
};

void run_scenes(const ScenesCommand& command) {
  SceneScaleOptions options = command.options;
  options.store = command.store;
  options.progress = [](const std::string& line) { fmt::print(stderr, "{}\n", line); };
  const SceneScaleResult result = run_scene_scale(options);
  scene_scale_report(result).write(command.json);
  fmt::print("{}", scene_scale_text(result));
}

void add_scenes(CLI::App& bench) {
  const auto scenes = std::make_shared<ScenesCommand>();
  SceneScaleOptions& options = scenes->options;
  CLI::App* command = bench.add_subcommand("scenes",
                                           "Load many generated houses twice, step a batch through them with a bounded scene cache, and "
                                           "explain each step that took longer than ten times the median");
  command->add_option("--scenes", options.scenes, "Number of generated houses, each with three to six rooms")->capture_default_str();
  command->add_option("--episodes", options.episodes_per_scene, "Episodes per house")->capture_default_str();
  command->add_option("--num-envs", options.num_envs, "Number of environments in the batch")->capture_default_str();
  command->add_option("--threads", options.threads, "Threads for the batch; 0: all cores")->capture_default_str();
  command->add_option("--cache-gb", options.cache_gb, "Size limit of the scene cache in GB")->capture_default_str();
  command->add_option("--minutes", options.minutes, "Time limit in minutes; the run stops when it is reached")->capture_default_str();
  command->add_option("--seed", options.seed, "Seed of houses and episodes")->capture_default_str();
  command->add_option("--store", scenes->store, "Folder for preprocessed scenes, about 9 MB each")->type_name(kOutputFolder)->required();
  command->add_option("--json", scenes->json, "Also write names, values and settings to this JSON file")->type_name(kOutputFile);
  command->callback([scenes] { run_scenes(*scenes); });
}

/// Adds a benchmark with the options common to all.
CLI::App* add_bench_command(CLI::App& bench, const std::string& name, const std::string& about,
                            const std::shared_ptr<BenchArguments>& options) {
  CLI::App* command = bench.add_subcommand(name, about);
  command->add_option("--json", options->json, "Also write names, medians, ranges and settings to this JSON file")->type_name(kOutputFile);
  command->add_flag("--quick", options->quick, "Short smoke test; its numbers are not meaningful");
  return command;
}

struct EnvCommand : BenchArguments {
  EnvBenchOptions bench;
  AxesOptions axes;
  std::string size;
  std::optional<double> seconds;
};

void add_env(CLI::App& bench) {
  const auto env = std::make_shared<EnvCommand>();
  CLI::App* command = add_bench_command(
      bench, "env",
      "Measure agent steps per second with all sensors and without, time per stage, percentiles of a step, memory, and bare ray tracing",
      env);
  command->add_option("--scene", env->bench.scene, "Scene to run in: SCENE as in 'earshot --help'")->capture_default_str();
  env->axes.add_to(*command);
  command->add_option("--envs", env->bench.envs, "Number of environments in the batch")->capture_default_str();
  command->add_option("--agents", env->bench.agents, "Agents per environment, visible to each other; rates count agent steps")
      ->capture_default_str();
  command->add_flag("--walk", env->bench.walk, "Random walks instead of the oracle, whose agents queue when they share a goal");
  command->add_option("--seconds", env->seconds, "Seconds per repeat (default: 3, or 0.2 with --quick)");
  command->add_flag("--agent-sounds", env->bench.agent_sounds, "Agents make sounds and hear each other");
  command->add_option("--size", env->size, "Image size as WIDTHxHEIGHT in pixels (default: 128x128)");
  command->add_option("--threads", env->bench.threads,
                      "Threads for the batch (default: measure one thread and two threads in separate rows)");
  command->add_option("--renderer", env->bench.renderer, "Image renderer: embree, egl or auto (egl where its device is a GPU)")
      ->capture_default_str();
  command->add_option("--egl-device", env->bench.egl_device, "EGL device: auto, software, a number from 'earshot doctor', a UUID or cuda:N")
      ->capture_default_str();
  command->add_flag("--field", env->bench.field,
                    "Take late sound from source fields of ten shared goals instead of tracing rays at each pose");
  command->add_flag("--autotune", env->bench.autotune,
                    "Instead: measure steps per second over numbers of agents and threads, and report the best setting for this machine");
  command->callback([env] {
    EnvBenchOptions& options = env->bench;
    options.scene = env->axes.applied_to({options.scene}).front();
    options.quick = env->quick;
    if (env->quick) options.repeats = 3, options.seconds = 0.2;
    if (env->seconds) options.seconds = *env->seconds;
    require(options.seconds > 0 && options.seconds <= 3600, "--seconds", options.seconds, "must be in (0, 3600]");
    if (!env->size.empty()) std::tie(options.width_px, options.height_px) = parse_picture_size(env->size, "128x128");
    finish(bench_env(options), *env);
  });
}

struct HearingCommand : BenchArguments {
  std::vector<std::string> scenes;
  AxesOptions axes;
  std::optional<double> truth_seconds;
};

void add_hearing(CLI::App& bench) {
  const auto hearing = std::make_shared<HearingCommand>();
  CLI::App* command = add_bench_command(
      bench, "hearing", "Compare 16, 64 and 256 rays per pose with source fields: cost for an environment, and errors of the sound",
      hearing);
  command->add_option("--scene", hearing->scenes, "Scene to measure instead of the two built-in ones; may be repeated")
      ->allow_extra_args(false);
  hearing->axes.add_to(*command);
  command->add_option("--reference-seconds", hearing->truth_seconds,
                      "Seconds per scene for the converged reference (default: 60, or 0.2 with --quick)");
  command->callback([hearing] {
    HearingCostOptions options{.quick = hearing->quick, .scenes = hearing->axes.applied_to(hearing->scenes)};
    options.truth_seconds = hearing->truth_seconds.value_or(hearing->quick ? 0.2 : 60);
    require(options.truth_seconds > 0 && options.truth_seconds <= 36'000, "--reference-seconds", options.truth_seconds,
            "must lie in (0, 36000]");
    const HearingCost cost = bench_hearing(options);
    fmt::print("\n{}", cost.markdown);
    finish(cost.report, *hearing);
  });
}

}  // namespace

void add_bench(CLI::App& app, const std::vector<std::string>& arguments, int& exit_code) {
  CLI::App* bench = app.add_subcommand(
      "bench",
      "Measure speed and accuracy on this machine: rir, env, hearing, accuracy, promise, scenes, soak, bits, train, allreduce, scaling");
  bench->require_subcommand(1);
  const auto rir = std::make_shared<RirCommand>();
  CLI::App* rir_command =
      add_bench_command(*bench, "rir", "Measure impulse responses per second on one thread, their errors, and the time per stage", rir);
  rir_command
      ->add_option("--scene", rir->scenes,
                   "Scene to measure instead of the two built-in ones; may be repeated. Errors are then relative to bidirectional paths "
                   "instead of a finer field")
      ->allow_extra_args(false);
  rir->axes.add_to(*rir_command);
  rir_command->add_option("--reference-seconds", rir->reference_seconds,
                          "Seconds per scene for the reference paths (default: 60, or 0.2 with --quick)");
  rir_command->add_option(
      "--reference-poses", rir->reference_poses,
      "Number of reference poses in a --scene; fewer poses give a more precise reference in the same time (default: 12)");
  rir_command->callback([rir] {
    RirBenchOptions options;
    options.quick = rir->quick;
    options.scenes = rir->axes.applied_to(rir->scenes);
    if (rir->quick) options.repeats = 3, options.poses = 2, options.error_fields = 2, options.reference_seconds = 0.2;
    if (rir->reference_seconds) options.reference_seconds = *rir->reference_seconds;
    require(options.reference_seconds > 0 && options.reference_seconds <= 36'000, "--reference-seconds", options.reference_seconds,
            "must lie in (0, 36000]");
    if (rir->reference_poses) options.path_poses = *rir->reference_poses;
    require(options.path_poses >= 1 && options.path_poses <= 24, "--reference-poses", options.path_poses, "must lie in [1, 24]");
    finish(bench_rir(options), *rir);
  });

  add_env(*bench);
  add_hearing(*bench);

  const auto accuracy = std::make_shared<AccuracyCommand>();
  CLI::App* command = add_bench_command(
      *bench, "accuracy",
      "Measure error against computing time: all presets and parameters in all scenes against a converged reference; tables and figures",
      accuracy);
  command->add_option("--out", accuracy->out, "Folder for accuracy.csv, accuracy_tables.md and the figures")
      ->type_name(kOutputFolder)
      ->capture_default_str();
  command->add_option("--minutes", accuracy->minutes,
                      "Minutes for the whole study; poses and repeats are reduced to fit (default: 20, or 2.5 with --quick)");
  command
      ->add_option("--engine", accuracy->engines,
                   "NAME=COMMAND: another engine to compare with in shoeboxes; may be repeated (protocol: docs/evidence/accuracy.md; "
                   "default: pyroomacoustics if python3 has it)")
      ->allow_extra_args(false);
  command->callback([accuracy] { run_accuracy(*accuracy); });

  const auto promise = std::make_shared<PromiseCommand>();
  CLI::App* promise_command = add_bench_command(
      *bench, "promise", "Check --accuracy in ten scenes: target, predicted and measured error, and the time saved against the presets",
      promise);
  promise_command->add_option("--scene", promise->scenes, "Scene to measure instead of the ten built-in ones; may be repeated")
      ->allow_extra_args(false);
  promise->axes.add_to(*promise_command);
  promise_command
      ->add_option("--target", promise->targets,
                   "Target error as in --accuracy; may be repeated (default: 2, 5 and 10 % of T20, each with 1 dB of drr and edc)")
      ->allow_extra_args(false);
  promise_command->callback([promise] { run_promise(*promise); });

  add_scenes(*bench);
  add_soak(*bench);
  add_bench_bits(*bench);
  add_bench_train(*bench);
  add_bench_allreduce(*bench, arguments, exit_code);
  add_bench_scaling(*bench, arguments, exit_code);
}

}  // namespace earshot
