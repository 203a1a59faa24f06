// SPDX-License-Identifier: Apache-2.0
#include "evaluation/leaderboard/sweep.h"

#include <fcntl.h>
#include <fmt/format.h>
#include <signal.h>
#include <sys/prctl.h>
#include <sys/wait.h>
#include <unistd.h>

#include <algorithm>
#include <cerrno>
#include <chrono>
#include <cstdio>
#include <cstring>
#include <exception>
#include <filesystem>
#include <memory>
#include <thread>

#include "apps/board/board_commands.h"
#include "apps/options/output_options.h"
#include "sim/base/errors.h"
#include "sim/base/files.h"
#include "sim/base/process/closed_pipe.h"
#include "sim/base/process/exit_codes.h"
#include "sim/base/process/progress.h"
#include "sim/base/process/stop_signals.h"
#include "sim/base/text/log.h"
#include "trainer/checkpoint/run_folder.h"
#include "trainer/checkpoint/run_lock.h"
#include "trainer/launch/launcher_job.h"

namespace earshot {
namespace {

struct SweepArguments {
  std::string file, json, run;
  bool report = false;
};

/// Beside a run's folder: its config and a mark that it ended as its config says.
std::filesystem::path file_beside(const SweepRun& run, const char* ending) { return run.folder.string() + ending; }
std::filesystem::path result_of(const SweepRun& run) { return file_beside(run, ".result.json"); }
std::filesystem::path log_of(const SweepRun& run) { return file_beside(run, ".log"); }

std::string settings_of(const SweepConfig& sweep, const SweepRun& run) {
  std::string text = sweep.config + "\n";
  for (const std::string& override : run.overrides) text += override + "\n";
  return text + config_text(run.config);
}

/// Settings of a result: another list of changes makes another result.
std::filesystem::path evaluated_with(const SweepRun& run) { return file_beside(run, ".evaluated"); }
std::string evaluation_settings(const SweepConfig& sweep) {
  std::string text;
  for (const std::string& override : *sweep.evaluate) text += override + "\n";
  return text;
}
bool evaluation_due(const SweepConfig& sweep, const SweepRun& run) {
  return sweep.evaluate && (!std::filesystem::exists(result_of(run)) || !std::filesystem::exists(evaluated_with(run)) ||
                            read_file(evaluated_with(run)) != evaluation_settings(sweep));
}

bool finished(const SweepRun& run) { return std::filesystem::exists(file_beside(run, ".done")); }

std::vector<SweepCurve> curves_of(const SweepConfig& sweep, const std::vector<SweepRun>& runs) {
  std::vector<SweepCurve> curves;
  for (const SweepRun& run : runs) {
    SweepCurve curve{.variant = run.variant, .seed = run.seed, .finished = finished(run), .points = {}};
    const std::filesystem::path log = RunFolder(run.folder).event_log();
    if (std::filesystem::exists(log)) curve.points = read_event_log(log);
    if (sweep.evaluate && !evaluation_due(sweep, run)) {
      const EvaluationResult result = load_result(result_of(run));
      curve.held_out_success = result.success().mean;
      curve.held_out_spl = result.spl().mean;
    }
    curves.push_back(std::move(curve));
  }
  return curves;
}

/// Env steps of a run that is under way.
std::uint64_t steps_of(const SweepRun& run) {
  try {
    const auto points = read_event_log(RunFolder(run.folder).event_log());
    return points.empty() ? 0 : points.back().env_steps;
  } catch (const InputError&) {
    return 0;  // not written yet
  }
}

std::string last_line(const std::filesystem::path& log) {
  std::string text = read_file(log);
  while (!text.empty() && text.back() == '\n') text.pop_back();
  return text.substr(text.rfind('\n') == std::string::npos ? 0 : text.rfind('\n') + 1);
}

/// Runs this program with these arguments, its output in a file; poll is called a few times a second.  Returns what waitpid says.
template <class Poll>
int run_program(const std::vector<std::string>& arguments, const std::filesystem::path& log, const Poll& poll) {
  std::vector<std::string> line{std::filesystem::read_symlink("/proc/self/exe").string()};
  line.insert(line.end(), arguments.begin(), arguments.end());
  std::vector<char*> argv;
  for (std::string& text : line) argv.push_back(text.data());
  argv.push_back(nullptr);
  std::filesystem::create_directories(log.parent_path());
  const int output = ::open(log.c_str(), O_WRONLY | O_CREAT | O_APPEND | O_CLOEXEC, 0644);
  if (output < 0) throw RunError(log.string(), fmt::format("cannot be written: {}", std::strerror(errno)));
  const pid_t parent = ::getpid(), pid = ::fork();
  if (pid == 0) {
    ::prctl(PR_SET_PDEATHSIG, SIGTERM);  // it leaves a checkpoint
    if (::getppid() != parent) ::_exit(1);
    ::dup2(output, STDOUT_FILENO);
    ::dup2(output, STDERR_FILENO);
    ::execv(argv[0], argv.data());
    ::_exit(127);
  }
  ::close(output);
  if (pid < 0) throw RunError("sweep", fmt::format("cannot start a run: {}", std::strerror(errno)));
  bool told = false;
  int status = 0;
  while (::waitpid(pid, &status, WNOHANG) == 0) {
    if (StopSignals::received() && !told) {
      ::kill(pid, SIGTERM);
      told = true;
    }
    poll();
    std::this_thread::sleep_for(std::chrono::milliseconds(200));
  }
  return status;
}

/// By a signal; the run under way has left its checkpoint.
class SweepStopped : public std::exception {};

void throw_if_stopped() {
  if (StopSignals::received()) throw SweepStopped();
}

void expect_done(int status, const std::string& command, const std::filesystem::path& log) {
  if (WIFEXITED(status) && WEXITSTATUS(status) == kExitDone) return;
  if (WIFSIGNALED(status) || is_orderly_end(WEXITSTATUS(status))) throw_if_stopped();
  if (WIFEXITED(status) && is_orderly_end(WEXITSTATUS(status)))
    throw RunError(command, "was stopped by a signal; the same command goes on");
  if (WIFSIGNALED(status))
    throw RunError(command, fmt::format("was killed by signal {} ({}); see its output in {}, then run the same command again to continue",
                                        WTERMSIG(status), ::strsignal(WTERMSIG(status)), log.string()));
  throw RunError(command, fmt::format("failed with code {}: {}; see its output in {}, then run the same command again to continue",
                                      WEXITSTATUS(status), last_line(log), log.string()));
}

/// A run of a sweep that was changed since is another run: its curve would be of two.
void refuse_other_settings(const SweepConfig& sweep, const SweepRun& run) {
  const std::filesystem::path file = file_beside(run, ".settings");
  if (std::filesystem::exists(file) && read_file(file) != settings_of(sweep, run))
    throw InputError(run.folder.string(), "was trained with settings that differ from the sweep file",
                     "restore the settings, rename the run, or remove the folder and the files next to it");
}

bool is_missing(const std::string& file) { return !file.empty() && !std::filesystem::exists(file); }

/// A set that only the evaluation names is made by no run: it would be missed after the first training.
void refuse_missing_set(const SweepConfig& sweep, const SweepRun& run) {
  const std::string& set = run.evaluated.eval.file;
  if (sweep.evaluate && set != run.config.eval.file && is_missing(set))
    throw InputError(set, "the episode set of `evaluate` does not exist",
                     "write it with 'earshot dataset episodes --config' from the config that it belongs to");
}

std::string name_of(const SweepRun& run) { return fmt::format("sweep run {} seed {}", run.variant, run.seed); }

void make_missing_sets(const SweepConfig& sweep, const SweepRun& run) {
  if (!is_missing(run.config.train.file) && !(sweep.evaluate && is_missing(run.config.eval.file))) return;
  std::vector<std::string> make{"dataset", "episodes", "--config", sweep.config};
  for (const std::string& override : run.overrides) make.insert(make.end(), {"--set", override});
  expect_done(run_program(make, log_of(run), [] {}), name_of(run) + ": its episodes", log_of(run));
  throw_if_stopped();
}

void train_run(const SweepConfig& sweep, const SweepRun& run, const std::string& label) {
  make_missing_sets(sweep, run);
  std::filesystem::remove(evaluated_with(run));  // a result of earlier weights
  write_file_atomically(file_beside(run, ".settings"), settings_of(sweep, run));
  std::vector<std::string> train{"train", sweep.config};
  train.insert(train.end(), run.overrides.begin(), run.overrides.end());
  if (RunFolder(run.folder).checkpoints().empty())
    train.emplace_back("--overwrite");
  else
    train.insert(train.end(), {"--resume", run.folder.string()});
  {
    Progress progress(label, "step", run.config.total_steps);
    expect_done(run_program(train, log_of(run), [&] { progress.update(std::min(steps_of(run), run.config.total_steps)); }), name_of(run),
                log_of(run));
  }
  throw_if_stopped();  // a run that was asked to stop ends well, before its time
  write_file_atomically(file_beside(run, ".done"), "");
}

/// On the held-out set of its config, in the environment that the sweep asks for.
void evaluate_run(const SweepConfig& sweep, const SweepRun& run, const std::string& label) {
  make_missing_sets(sweep, run);
  std::filesystem::remove(evaluated_with(run));  // until the new result is there
  std::vector<std::string> evaluate{
      "eval", run.folder.string(), "--out", result_of(run).string(), "--workers", std::to_string(run.config.workers)};
  for (const std::string& override : *sweep.evaluate) evaluate.insert(evaluate.end(), {"--set", override});
  std::fputs((label + ": evaluation\n").c_str(), stderr);
  expect_done(run_program(evaluate, log_of(run), [] {}), name_of(run) + ": its evaluation", log_of(run));
  throw_if_stopped();
  write_file_atomically(evaluated_with(run), evaluation_settings(sweep));
}

void write_report(const SweepArguments& options, const SweepConfig& sweep, const std::vector<SweepRun>& runs) {
  const auto curves = curves_of(sweep, runs);
  const std::filesystem::path out = sweep.out;
  write_file_atomically(out / "sweep.json", sweep_json(sweep, curves));
  write_file_atomically(out / "sweep.svg", sweep_svg(sweep, curves));
  write_file_atomically(out / "index.html", sweep_html(sweep, curves));
  write_file_atomically(out / "table.txt", sweep_text(sweep_rows(curves)));
  if (!options.json.empty()) write_file_atomically(options.json, sweep_json(sweep, curves));
}

/// Trains and evaluates as far as the run is not.  index: from 0 of `total`, for the progress.
void complete_run(const SweepConfig& sweep, const SweepRun& run, std::size_t index, std::size_t total) {
  const std::string label = fmt::format("[{}/{}] {} seed {}", index + 1, total, run.variant, run.seed);
  if (!finished(run)) train_run(sweep, run, label);
  if (evaluation_due(sweep, run)) evaluate_run(sweep, run, label);
}

int say_stopped() {
  log_warning("sweep: was stopped; the same command goes on with it");
  return exit_code_after(StopSignals::signal());
}

/// --run: one run for another machine.  `earshot train` locks its folder; the table is that of --report.
int run_one(const SweepArguments& options, const SweepConfig& sweep, const std::vector<SweepRun>& runs) {
  const auto name = [](const SweepRun& run) { return fmt::format("{}/seed_{}", run.variant, run.seed); };
  const auto run = std::ranges::find(runs, options.run, name);
  if (run == runs.end()) {
    std::string names;
    for (const SweepRun& other : runs) names += (names.empty() ? "" : ", ") + name(other);
    throw InputError("--run " + options.run, "is no run of this sweep", "one of: " + names);
  }
  const StopSignals signals;
  try {
    complete_run(sweep, *run, static_cast<std::size_t>(run - runs.begin()), runs.size());
  } catch (const SweepStopped&) {
    return say_stopped();
  }
  fmt::print("{}: finished\n", run->folder.string());
  return kExitDone;
}

int run_sweep(const SweepArguments& options) {
  outlive_closed_pipes();
  const SweepConfig sweep = load_sweep(options.file);
  const std::filesystem::path out = sweep.out;
  check_named_outputs({{"--json", options.json},
                       {"the page", out / "index.html"},
                       {"the curves", out / "sweep.svg"},
                       {"the table", out / "table.txt"},
                       {"the numbers", out / "sweep.json"}},
                      {{.option = "the sweep", .path = sweep.config}});
  const std::vector<SweepRun> runs = runs_of(sweep);  // whatever is wrong with one of them is said before the first
  for (const SweepRun& run : runs) {
    refuse_other_settings(sweep, run);
    refuse_missing_set(sweep, run);
  }
  if (!options.run.empty()) return run_one(options, sweep, runs);
  if (!options.report) {
    const auto lock = RunLock::acquire(sweep.out, "earshot sweep", run_lock_options(launcher_job()));
    const StopSignals signals;
    try {
      for (std::size_t i = 0; i < runs.size(); ++i) {
        if (finished(runs[i]) && !evaluation_due(sweep, runs[i])) continue;
        complete_run(sweep, runs[i], i, runs.size());
        write_report(options, sweep, runs);
      }
    } catch (const SweepStopped&) {
      return say_stopped();
    }
  }
  write_report(options, sweep, runs);
  fmt::print("{}page: {}\n", sweep_text(sweep_rows(curves_of(sweep, runs))), (std::filesystem::path(sweep.out) / "index.html").string());
  return kExitDone;
}

}  // namespace

void add_sweep(CLI::App& app, int& exit_code) {
  auto options = std::make_shared<SweepArguments>();
  CLI::App* command =
      app.add_subcommand("sweep", "Train variants of a run config with several seeds each, and compare their learning curves");
  command->add_option("SWEEP", options->file, "Sweep file (YAML), for example configs/sweeps/learning_rate.yaml")->required();
  auto* report = command->add_flag("--report", options->report, "Do not train: print the table and curves of the finished runs");
  auto* run =
      command
          ->add_option("--run", options->run,
                       "NAME/seed_N: train and evaluate only this run, for sweeps over several machines; --report then writes the table")
          ->excludes(report);
  command->add_option("--json", options->json, "Also write the numbers to this JSON file")->type_name(kOutputFile)->excludes(run);
  command->footer(
      "Keys of SWEEP:\n"
      "  config     run config that all runs start from\n"
      "  seeds      list of seeds\n"
      "  runs       {NAME: [key=value, ...]}: changes of each variant\n"
      "  name       optional; default: name of the file\n"
      "  out        optional; default: runs/sweeps/NAME\n"
      "  set        optional, [key=value, ...]: changes for all runs\n"
      "  evaluate   optional, [key=value, ...]: evaluates each finished run on data.eval of its config, with these changes ([]: none)\n"
      "Runs are trained one after the other with the workers of the config.  The same command resumes an interrupted sweep: finished runs\n"
      "are kept, and an interrupted run continues from its last checkpoint.  After each run `out` is updated: NAME/seed_N, table.txt,\n"
      "sweep.json, sweep.svg and index.html.");
  command->callback([options, &exit_code] { exit_code = run_sweep(*options); });
}

}  // namespace earshot
