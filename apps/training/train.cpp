// SPDX-License-Identifier: Apache-2.0
#include <fmt/format.h>

#include <chrono>
#include <memory>

#include "apps/commands.h"
#include "evaluation/results/held_out_check.h"
#include "evaluation/results/held_out_evaluation.h"
#include "sim/base/engine_hash.h"
#include "sim/base/process/closed_pipe.h"
#include "sim/base/process/exit_codes.h"
#include "sim/base/process/machine_limits.h"
#include "sim/base/temporary_folder.h"
#include "sim/base/text/log.h"
#include "trainer/checkpoint/find_checkpoint.h"
#include "trainer/checkpoint/run_folder.h"
#include "trainer/checkpoint/run_lock.h"
#include "trainer/collective/collective.h"
#include "trainer/collective/gloo_exchange.h"
#include "trainer/collective/mpi/mpi_exchange.h"
#include "trainer/collective/worker_exchange.h"
#include "trainer/launch/launcher_job.h"
#include "trainer/launch/transport.h"
#include "trainer/launch/worker_group.h"
#include "trainer/net/host_address.h"
#include "trainer/run/effective_config.h"
#include "trainer/run/field_decision.h"
#include "trainer/run/planned_acoustics.h"
#include "trainer/run/resource_need.h"
#include "trainer/run/start_run.h"
#include "trainer/run/train_loop.h"

namespace earshot {
namespace {

/// Of workers whose run ends by the loss of another: for the checkpoint that they leave.
constexpr std::chrono::seconds kGrace(15);

struct TrainArguments {
  std::string config, resume;
  std::vector<std::string> overrides, changes;
  int workers = 0;
  bool elastic = false, overwrite = false, insecure_network = false, join = false, force = false;
};

/// The config with the choice that env.accuracy asks for: kept by the run or by the one that is resumed, or made now.  Workers read what
/// was kept before they were started.
RunConfig with_acoustics(const RunConfig& config, const RunStart& start, bool is_worker, const std::string& config_file) {
  std::vector<std::filesystem::path> folders = {config.out};
  if (!start.resume.empty()) folders.push_back(run_folder_of(start.resume));
  if (auto kept = with_kept_acoustics(config, folders)) return *kept;
  if (is_worker)
    throw InputError("env.accuracy " + config.env.accuracy, "has no plan, and workers under a launcher do not make one",
                     "run 'earshot plan " + config_file + "' once before the launch");
  if (!start.resume.empty())
    throw InputError("env.accuracy " + config.env.accuracy, "has no plan in the resumed run, or its plan is for another config",
                     "copy its " + acoustics_plan_file(config, {}).string() + " to " + config.out + ", or start a new run");
  // Before the minutes that a plan may take.
  refuse_mixed_runs(config, start);
  refuse_stale_episodes(config, start);
  return plan_acoustics(config);
}

/// What a run that evaluates itself has found, with its line end; empty for others.
std::string held_out_text(const RunConfig& config, const HeldOutState& state) {
  if (!config.held_out.is_on()) return {};
  if (state.best_update == 0)
    return fmt::format("held out: no evaluation yet; they come every {} updates\n", config.held_out.every_updates);
  const HeldOutEstimate& success = state.best.success;
  const bool has_stopped = has_stopped_learning(config.held_out, state);
  return fmt::format("held out: {} evaluations in {:.1f} min; best update {}, success {:.3f} [{:.3f}, {:.3f}], SPL {:.3f}{}\n",
                     state.evaluations, state.seconds / 60, state.best_update, success.mean, success.low, success.high, state.best.spl.mean,
                     has_stopped ? fmt::format("; ended: no better one in {}", state.since_best) : std::string());
}

std::string end_text(const RunConfig& config, const TrainReport& report) {
  return fmt::format("{} updates, {} steps in {:.1f} min: {:.0f} steps/s\n{}{}checkpoint: {}\n", report.updates, report.env_steps,
                     report.wall_s / 60, report.steps_per_s, summary(report.counters, report.guards),
                     held_out_text(config, report.held_out), report.checkpoint.string());
}

/// What rank 0 says of the workers and of what connects them.
void announce(const LaunchedWorker& launched) {
  const RingConfig& ring = launched.ring;
  const bool is_ring = ring.network.collective == Transport::zeromq;
  if (launched.launcher != "EARSHOT_RANK")
    fmt::print("{} workers started by {}, {}\n", ring.identity.world_size, launched.launcher,
               is_ring ? "rendezvous at " + ring.rendezvous : "connected by " + name_of(ring.network.collective));
  if (!is_ring) log_info(fmt::format("workers are connected by {}: {}", name_of(ring.network.collective), launched.transport_reason));
}

std::unique_ptr<Collective> connect(const RingConfig& ring, bool joins) {
  if (ring.network.collective == Transport::mpi) return make_ordered_collective(join_mpi(ring));
  if (ring.network.collective == Transport::gloo) return make_ordered_collective(join_gloo(ring));
  return joins ? make_joining_worker(ring) : make_zmq_ring(ring);
}

/// The workers of this run, once all are there.  elastic: whoever does not find the others is to be started again, as they may be.
std::unique_ptr<Collective> meet(const RingConfig& ring, bool joins, bool elastic) {
  try {
    return connect(ring, joins);
  } catch (const UnknownHost& error) {  // a pod that has not been placed yet has no name
    if (elastic) throw WorldLost("rendezvous", error.what());
    throw;
  } catch (const WorldIncomplete& error) {
    if (elastic) throw WorldLost("rendezvous", error.what());
    throw;
  }
}

int run_train(const TrainArguments& options, const std::vector<std::string>& arguments) {
  outlive_closed_pipes();
  // Everything that can be wrong with the input is found before a process is started.
  std::vector<std::string> overrides = options.overrides;
  if (options.insecure_network) overrides.emplace_back("network.insecure=true");
  const RunConfig asked = load_run_config(options.config, overrides);
  const auto launched = worker_from_environment(asked.network);
  const bool is_worker = launched.has_value();
  const int workers = options.workers > 0 ? options.workers : asked.workers;
  validate_world(is_worker ? launched->ring.identity.world_size : workers, asked.network.on_loss);
  if (is_worker && options.workers > 0 && options.workers != launched->ring.identity.world_size)
    throw InputError(fmt::format("--workers {}", options.workers),
                     fmt::format("starts processes on this machine, but {} has already started {} workers", launched->launcher,
                                 launched->ring.identity.world_size),
                     "leave out --workers, and set the number of workers in the launcher");
  if (!is_worker && workers > 1) {
    static_cast<void>(temporary_parent());  // where they are to meet
    static_cast<void>(choose_transport(asked.network, workers, false));
  }
  if (options.join)
    require(asked.network.collective == Transport::automatic || asked.network.collective == Transport::zeromq, "network.collective",
            name_of(asked.network.collective), "takes no workers that join: --join needs zeromq");
  RunStart start;
  if (is_worker) start.lock = RunLock::inherited(asked.out);
  // The process that has started its workers itself has counted them.
  if (!options.force && !start.lock) refuse_beyond_machine(asked, is_worker ? 1 : workers, machine_limits());
  if (!is_worker && asked.train.file.empty())
    throw InputError(options.config, "has no data.train.file",
                     "add the key, then write the episodes with 'earshot dataset episodes --config'");
  if (!is_worker && !std::filesystem::exists(asked.train.file))
    throw InputError(asked.train.file, "does not exist",
                     "write the episode set with 'earshot dataset episodes --config " + options.config + "'");
  if (options.elastic && (options.join || !options.resume.empty()))
    throw InputError("--elastic", options.join ? "starts workers together, and --join starts one alone" : "chooses the checkpoint itself",
                     options.join ? "give only one of them" : "leave out --resume");
  if (options.elastic && options.overwrite)
    throw InputError("--overwrite", "would delete the run at each restart of --elastic", "give only one of them");
  if (options.join && !is_worker)
    throw InputError("--join", "needs a launcher, and no launcher variables are set",
                     "set the environment variables of the lost worker (docs/howto/hosts.md, section 4)");
  if (!is_worker) start.lock = RunLock::acquire(asked.out, "earshot train", run_lock_options(launcher_job()));
  if (!options.resume.empty()) start.resume = find_checkpoint(options.resume);
  start.elastic = options.elastic;
  start.overwrite = options.overwrite;
  if (start.elastic) start.resume = newest_checkpoint(asked);
  if (is_worker && !start.resume.empty() && start.elastic && has_reached_end(asked, load_checkpoint_metadata(start.resume))) {
    // Others may have ended before this worker was started again.
    if (launched->ring.identity.rank == 0) fmt::print("the run has ended: {}\n", start.resume.string());
    return kExitDone;
  }
  start.changes = options.changes;
  start.remake = "earshot dataset episodes --config " + options.config;
  for (const auto& override : options.overrides) start.remake += " --set " + override;

  const FieldDecision decided = decide_field(with_acoustics(asked, start, is_worker, options.config), start.resume);
  const RunConfig& config = decided.config;
  start.note = decided.text;
  check_held_out(config, start.remake, is_worker ? HeldOutCheck::names : HeldOutCheck::all);

  if (!is_worker && workers > 1) {
    prepare_run(config, start);
    Handed handed{.variables = {start.lock->variable()}};
    if (start.lock->descriptor() >= 0) handed.descriptors = {start.lock->descriptor()};
    return spawn_workers(workers, arguments, kGrace, config.network.on_loss, config.network.restarts, handed);
  }

  if (is_worker && launched->ring.identity.rank == 0) announce(*launched);
  RingConfig ring = is_worker ? launched->ring : RingConfig{};
  if (config.network.on_loss == OnLoss::go_on) {
    ring.engine = engine_hash();
    ring.settings = common_settings(config);
  }
  const std::unique_ptr<Collective> collective = is_worker ? meet(ring, options.join, options.elastic) : make_single_worker();
  const std::unique_ptr<HeldOutEvaluator> held_out = make_held_out_evaluator(config);
  const TrainReport report = train(config, *collective, start, {.held_out = held_out.get()});
  if (collective->identity().rank == 0) fmt::print("{}", end_text(config, report));
  return exit_code_after(report.signal);
}

}  // namespace

void add_train(CLI::App& app, const std::vector<std::string>& arguments, int& exit_code) {
  auto options = std::make_shared<TrainArguments>();
  CLI::App* command = app.add_subcommand("train", "Train a policy with DD-PPO");
  command->add_option("CONFIG", options->config, "Run config (YAML)")->required();
  command->add_option("OVERRIDES", options->overrides, "Override keys of the config: key=value, for example ppo.learning_rate=1e-4");
  command->add_option("--workers", options->workers,
                      "Worker processes on this machine (default: `workers` of the config); not allowed under a launcher");
  command->add_option("--resume", options->resume, "Run folder or checkpoint to continue from");
  command->add_flag("--elastic", options->elastic,
                    "Continue the run in `out` from its newest checkpoint with any number of workers; start it if there is none.\n"
                    "For launchers that restart workers with the same command (docs/howto/elastic.md)");
  command
      ->add_option("--change", options->changes,
                   "With --resume: keys or sections whose values may differ from the checkpoint's; 'engine' allows another build")
      ->delimiter(',')
      ->allow_extra_args(false);
  command->add_flag("--overwrite", options->overwrite,
                    "Delete the files of an earlier run in `out` first; without this flag training stops at such a folder");
  command->add_flag("--join", options->join,
                    "Join a running training in the place of a lost worker (network.on_loss: continue; docs/howto/hosts.md).\n"
                    "Repeat the options of the first start; they are not applied again");
  command->add_flag("--force", options->force, "Start even if the run needs more memory or processes than this machine has");
  command->add_flag("--insecure-network", options->insecure_network,
                    "Allow connections between hosts without encryption and keys (network.insecure=true)");
  command->footer(
      "Writes checkpoints, events.jsonl and TensorBoard curves to the folder `out` of the config.\n"
      "SIGTERM, SIGINT, SIGHUP and SIGUSR1 stop the run after the current update and write a checkpoint.\n"
      "A resumed run gives the same bits as an uninterrupted one.  Training stops if the config or the engine differs from the "
      "checkpoint's,\n"
      "unless --change names the difference.\n"
      "\n"
      "Keys of CONFIG about files:\n"
      "  env.field_store=FOLDER     source fields (env.acoustics.field), shared by workers and later runs (default: `out`/fields)\n"
      "  env.field_store_gb=20      size limit of this folder; the least recently used fields are removed first\n"
      "  env.scene_store=FOLDER     preprocessed scenes, shared by workers and later runs; empty: each worker preprocesses its scenes\n"
      "  env.scene_store_gb=20      size limit of this folder\n"
      "  env.quarantine_dir=FOLDER  one file per faulty episode, which 'earshot replay' runs again (default: `out`/quarantine)\n"
      "  checkpoint_every=50        updates between checkpoints; a full disk is reported and training continues\n"
      "  keep=3                     number of recent checkpoints to keep, in addition to best.ckpt and last.ckpt\n"
      "Keys of CONFIG about evaluations while the run trains (off by default; they need data.held_out):\n"
      "  held_out.every_updates=50  updates between evaluations on data.held_out; the best one is best.ckpt\n"
      "  held_out.max_fraction=0.1     their largest part of all environment steps, with schedule: minutes of the wall time\n"
      "  held_out.patience=5        end the run after so many evaluations in a row without a better one; 0: never\n"
      "All keys, curves and counters: docs/howto/training.md.  Several machines, srun, mpirun, torchrun and Kubernetes:\n"
      "docs/howto/hosts.md.");
  command->callback([options, &arguments, &exit_code] { exit_code = run_train(*options, arguments); });
}

}  // namespace earshot
