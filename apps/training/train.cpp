#include <fmt/format.h>

#include <chrono>
#include <memory>

#include "apps/commands.h"
#include "sim/base/engine_hash.h"
#include "trainer/checkpoint/find_checkpoint.h"
#include "trainer/checkpoint/run_folder.h"
#include "trainer/collective/collective.h"
#include "trainer/launch/worker_group.h"
#include "trainer/run/effective_config.h"
#include "trainer/run/field_decision.h"
#include "trainer/run/planned_acoustics.h"
#include "trainer/run/start_run.h"
#include "trainer/run/train_loop.h"

namespace earshot {
namespace {

struct TrainArguments {
  std::string config, resume;
  std::vector<std::string> overrides, changes;
  int workers = 0;
  bool overwrite = false, insecure_network = false, join = false;
};

/// The config with the choice that env.accuracy asks for: kept by the run or by the one that is resumed, or made now.  Workers read what
/// was kept before they were started.
RunConfig with_acoustics(const RunConfig& config, const RunStart& start, bool is_worker, const std::string& config_file) {
  std::vector<std::filesystem::path> folders = {config.out};
  if (!start.resume.empty()) folders.push_back(run_folder_of(start.resume));
  if (auto kept = with_kept_acoustics(config, folders)) return *kept;
  if (is_worker)
    throw InputError("env.accuracy " + config.env.accuracy, "has not been planned, and a worker of a launcher does not",
                     "run 'earshot plan " + config_file + "' once before");
  if (!start.resume.empty())
    throw InputError("env.accuracy " + config.env.accuracy, "was not planned by the run to go on with, or for another config",
                     "copy its " + acoustics_plan_file(config, {}).string() + " to " + config.out + ", or start a new run");
  // Before the minutes that a plan may take.
  refuse_mixed_runs(config, start);
  refuse_stale_episodes(config, start);
  return plan_acoustics(config);
}

int run_train(const TrainArguments& options, const std::vector<std::string>& arguments) {
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
                     fmt::format("starts processes on this machine, and {} has started {} workers already", launched->launcher,
                                 launched->ring.identity.world_size),
                     "leave it out, and ask the launcher for as many workers as are to train");
  if (!is_worker && asked.train.file.empty())
    throw InputError(options.config, "names no data.train.file", "add it, and write it with 'earshot dataset episodes --config'");
  if (!is_worker && !std::filesystem::exists(asked.train.file))
    throw InputError(asked.train.file, "no such episode set", "write it with 'earshot dataset episodes --config " + options.config + "'");
  if (options.join && !is_worker)
    throw InputError("--join", "is for a worker of a launcher, and there is none",
                     "set the variables with which this worker was started (docs/howto/hosts.md, section 4)");
  RunStart start;
  if (!options.resume.empty()) start.resume = find_checkpoint(options.resume);
  start.overwrite = options.overwrite;
  start.changes = options.changes;
  start.remake = "earshot dataset episodes --config " + options.config;
  for (const auto& override : options.overrides) start.remake += " --set " + override;

  const FieldDecision decided = decide_field(with_acoustics(asked, start, is_worker, options.config), start.resume);
  const RunConfig& config = decided.config;
  start.note = decided.text;

  if (!is_worker && workers > 1) {
    prepare_run(config, start);
    return spawn_workers(workers, arguments, std::chrono::seconds(5), config.network.on_loss, config.network.restarts);
  }

  if (is_worker && launched->launcher != "EARSHOT_RANK" && launched->ring.identity.rank == 0)
    fmt::print("{} workers started by {} meet at {}\n", launched->ring.identity.world_size, launched->launcher, launched->ring.rendezvous);
  RingConfig ring = is_worker ? launched->ring : RingConfig{};
  if (config.network.on_loss == OnLoss::go_on) {
    ring.engine = engine_hash();
    ring.settings = common_settings(config);
  }
  TrainReport report;
  std::unique_ptr<Collective> collective;
  try {
    collective = !is_worker ? make_single_worker() : options.join ? make_joining_worker(ring) : make_zmq_ring(ring);
    report = train(config, *collective, start);
  } catch (const LeftOut& error) {
    fmt::print(stderr, "earshot: {}\n", error.what());
    return kLeftOutExitCode;
  }
  if (collective->identity().rank == 0)
    fmt::print("{} updates, {} steps in {:.1f} min: {:.0f} steps/s\n{}checkpoint: {}\n", report.updates, report.env_steps,
               report.wall_s / 60, report.steps_per_s, summary(report.counters, report.guards), report.checkpoint.string());
  return 0;
}

}  // namespace

void add_train(CLI::App& app, const std::vector<std::string>& arguments, int& exit_code) {
  auto options = std::make_shared<TrainArguments>();
  CLI::App* command = app.add_subcommand("train", "Train a policy with DD-PPO");
  command->add_option("CONFIG", options->config, "Run config (YAML)")->required();
  command->add_option("OVERRIDES", options->overrides, "key=value over the config, for example ppo.learning_rate=1e-4");
  command->add_option("--workers", options->workers,
                      "Worker processes on this machine (default: the config's); not within a launcher, which starts them");
  command->add_option("--resume", options->resume, "Run folder or checkpoint to go on from");
  command->add_option("--change", options->changes, "With --resume: keys or sections that may differ from the checkpoint's, and 'engine'")
      ->delimiter(',')
      ->allow_extra_args(false);
  command->add_flag("--overwrite", options->overwrite,
                    "Remove the files of an earlier run in `out` first; without it such a folder is refused");
  command->add_flag(
      "--join", options->join,
      "Come (back) to a run under way in the place of a lost worker, where network.on_loss is continue (docs/howto/hosts.md);\n"
      "beside the options of the first start, which are not carried out again");
  command->add_flag("--insecure-network", options->insecure_network,
                    "Let links between hosts go without encryption and without keys (network.insecure=true)");
  command->footer(
      "Writes checkpoints, events.jsonl and TensorBoard curves under the config's `out`.  SIGTERM, SIGINT, SIGHUP and SIGUSR1 end the "
      "run\n"
      "after the current update with a checkpoint.  A resumed run gives the bits that the unbroken one would have given: another config "
      "or\n"
      "engine than the checkpoint's is refused unless --change declares it.\n\n"
      "Keys of CONFIG that save or keep something on disk:\n"
      "  env.field_store=FOLDER     source fields (env.acoustics.field) that all workers and later runs share (default: `out`/fields)\n"
      "  env.field_store_gb=20      bound of that folder; the least recently used go first\n"
      "  env.scene_store=FOLDER     preprocessed scenes that all workers and later runs share; empty: each worker makes them\n"
      "  env.scene_store_gb=20      bound of that folder\n"
      "  env.quarantine_dir=FOLDER  episodes that went wrong, each as a file that replays it (default: `out`/quarantine)\n"
      "  checkpoint_every=50        updates between checkpoints; a full disk is reported and training goes on\n"
      "  keep=3                     newest checkpoints that stay, beside best.ckpt and last.ckpt\n"
      "All keys, curves and counters: docs/howto/training.md.  Several machines, srun, mpirun, torchrun and Kubernetes: "
      "docs/howto/hosts.md.");
  command->callback([options, &arguments, &exit_code] { exit_code = run_train(*options, arguments); });
}

}  // namespace earshot
