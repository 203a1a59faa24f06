// SPDX-License-Identifier: Apache-2.0
#include <fmt/format.h>

#include <memory>
#include <nlohmann/json.hpp>
#include <string>
#include <thread>
#include <vector>

#include "apps/commands.h"
#include "apps/options/output_options.h"
#include "bench/measure/bench_report.h"
#include "bench/training/all_reduce_speed.h"
#include "bench/training/scaling_check.h"
#include "sim/base/errors.h"
#include "sim/base/files.h"
#include "sim/base/temporary_folder.h"
#include "sim/base/text/json.h"
#include "trainer/collective/collective.h"
#include "trainer/launch/worker_group.h"

namespace earshot {
namespace {

using nlohmann::json;

struct BenchScalingArguments {
  std::vector<int> ranks{2, 4, 8}, predicted{8, 32, 128, 1024};
  ScalingCheckOptions check;
  double step_ms = 5, learn_ms = 40, kib = 19345.52;
  // Of the training that is predicted: 8 envs and 128 steps of the published network on a core (docs/explanation/ppo.md, section 8).
  double rollout_s = 10, rollout_spread = 0.3, learn_s = 8.8;
  double latency_us = 0, gbit_per_s = 0;
  std::string json, times;
  bool quick = false;
};

/// Work of a worker; rank 0 writes the measurements of all.
void measure(const BenchScalingArguments& options, const LaunchedWorker& worker) {
  const auto workers = connect_over_loopback(worker.ring);
  json result = json::object();
  if (worker.ring.identity.world_size == 2) {
    const LinkSpeed link = measure_link(options.check.bytes, *workers);
    result["link"] = {link.exchange_s, link.step_s, link.bytes_per_s, link.message_s, link.byte_s};
  }
  const MeasuredUpdates measured = make_updates(options.check, *workers);
  if (worker.ring.identity.rank != 0) return;
  result["update_s"] = measured.update_s;
  write_file_atomically(options.times, json_text(result));
}

json run_workers(int ranks, std::vector<std::string> arguments, const std::string& file, int& code) {
  arguments.insert(arguments.end(), {"--times", file});
  code = spawn_workers(ranks, arguments);
  return code == 0 ? parse_json(read_file(file)) : json();
}

LinkSpeed link_of(const json& numbers) {
  const auto number = [&](std::size_t i) { return numbers.at(i).get<double>(); };
  return {.exchange_s = number(0), .step_s = number(1), .bytes_per_s = number(2), .message_s = number(3), .byte_s = number(4)};
}

void print_link(const char* name, const LinkSpeed& link) {
  fmt::print("{}: exchange {:.3f} ms, ring step {:.3f} ms and {:.2f} GB/s; CPU time {:.3f} ms per message and {:.2f} ns per byte\n", name,
             1e3 * link.exchange_s, 1e3 * link.step_s, 1e-9 * link.bytes_per_s, 1e3 * link.message_s, 1e9 * link.byte_s);
}

void predict_large(const BenchScalingArguments& options, LinkSpeed link, BenchReport& report) {
  if (options.latency_us > 0) link.exchange_s = link.step_s = 1e-6 * options.latency_us;
  if (options.gbit_per_s > 0) link.bytes_per_s = 1e9 / 8 * options.gbit_per_s;
  UpdateWork work{.rollout_s = options.rollout_s,
                  .rollout_deviation_s = options.rollout_spread * options.rollout_s,
                  .learn_s = options.learn_s,
                  .sums = options.check.sums,
                  .bytes = options.check.bytes,
                  .exchanges = options.check.exchanges};
  fmt::print(
      "\n"
      "prediction: rollouts of {:g} s (relative standard deviation {:g}), {:g} s of learning, {} sums of {:.1f} MB, one worker per host\n",
      work.rollout_s, options.rollout_spread, work.learn_s, work.sums, 1e-6 * static_cast<double>(work.bytes));
  print_link("link", link);
  fmt::print("{:>8}{:>14}{:>14}{:>14}{:>14}{:>20}\n", "workers", "waiting s", "sums s", "update s", "efficiency", "with preemption 0.6");
  for (const int workers : options.predicted) {
    const WorkerLayout all{.workers = workers}, most{.workers = workers, .preempt_fraction = 0.6};
    const ScalingPrediction update = predict_update(work, link, all);
    const double efficiency = scaling_efficiency(work, link, all), preempted = scaling_efficiency(work, link, most);
    fmt::print("{:>8}{:>14.2f}{:>14.3f}{:>14.2f}{:>14.3f}{:>20.3f}\n", workers, update.collect_s - work.rollout_s, update.reduce_s,
               update.update_s(), efficiency, preempted);
    report.add("scaling.efficiency", "1", {efficiency, efficiency, efficiency}, {{"workers", workers}, {"preempt_fraction", 0}});
    report.add("scaling.efficiency", "1", {preempted, preempted, preempted}, {{"workers", workers}, {"preempt_fraction", 0.6}});
  }
  fmt::print(
      "assumptions: independent normal rollout times, equal learning time on all workers, links of equal speed;\n"
      "small calls go between all workers up to 64 workers, and through a tree of eight children beyond;\n"
      "the batch grows with the number of workers, and its effect on learning is not modelled\n");
}

int run(BenchScalingArguments options, const std::vector<std::string>& arguments) {
  require(options.step_ms > 0 && options.step_ms <= 1000, "--step-ms", options.step_ms, "must be in (0, 1000]");
  require(options.learn_ms >= 0 && options.learn_ms <= 1e5, "--learn-ms", options.learn_ms, "must be in [0, 100000]");
  require(options.kib >= 64 && options.kib <= 1024 * 1024, "--kib", options.kib,
          "must lie in [64, 1048576]: smaller sums do not use the ring");
  require(options.check.spread >= 0 && options.check.spread <= 1, "--spread", options.check.spread, "must be in [0, 1]");
  require(options.check.rollout_steps >= 1 && options.check.rollout_steps <= 10000, "--rollout-steps", options.check.rollout_steps,
          "must be in [1, 10000]");
  require(options.check.updates >= 2 && options.check.updates <= 10000, "--updates", options.check.updates, "must be in [2, 10000]");
  require(options.rollout_s > 0 && options.rollout_s <= 1e5, "--rollout-s", options.rollout_s, "must be in (0, 100000]");
  require(options.rollout_spread >= 0 && options.rollout_spread <= 1, "--rollout-spread", options.rollout_spread, "must be in [0, 1]");
  require(options.learn_s >= 0 && options.learn_s <= 1e5, "--learn-s", options.learn_s, "must be in [0, 100000]");
  require(options.latency_us >= 0 && options.latency_us <= 1e6, "--latency-us", options.latency_us, "must be in [0, 1000000]");
  require(options.gbit_per_s >= 0 && options.gbit_per_s <= 1e5, "--gbit-per-s", options.gbit_per_s, "must be in [0, 100000]");
  for (const int ranks : options.ranks)
    require(ranks >= 2 && ranks <= kMaxWorkers, "--ranks", ranks, fmt::format("must be 2 to {}", kMaxWorkers));
  for (const int workers : options.predicted) require(workers >= 1 && workers <= 4096, "--predict", workers, "must be 1 to 4096");
  if (options.quick) options.check.updates = 3, options.check.rollout_steps = 4, options.ranks = {2, 3};
  options.check.step_s = 1e-3 * options.step_ms;
  options.check.learn_s = 1e-3 * options.learn_ms;
  options.check.bytes = static_cast<std::size_t>(options.kib * 256) * sizeof(float);
  if (const auto worker = worker_from_environment()) {
    if (options.times.empty())
      throw InputError("bench scaling", "starts its own workers and cannot run under a launcher",
                       "run it without srun, mpirun or torchrun");
    measure(options, *worker);
    return 0;
  }

  const TemporaryFolder folder(temporary_parent(), "earshot_bench_scaling_");
  const std::string file = (folder.path() / "times.json").string();
  BenchReport report("scaling");
  const auto alone = make_single_worker();
  const UpdateWork work = work_of(options.check, make_updates(options.check, *alone));
  int code = 0;
  const json two = run_workers(2, arguments, file, code);
  if (code != 0) return code;
  const LinkSpeed link = link_of(two.at("link"));
  const int cores = std::max(1, static_cast<int>(std::thread::hardware_concurrency()));
  fmt::print(
      "one worker: rollouts of {:.1f} ms (standard deviation {:.1f} ms), {:.1f} ms of learning, {} sums of {:.1f} MB, {} exchanges\n",
      1e3 * work.rollout_s, 1e3 * work.rollout_deviation_s, 1e3 * work.learn_s, work.sums, 1e-6 * static_cast<double>(work.bytes),
      work.exchanges);
  print_link("two workers, tcp on the loopback interface", link);
  fmt::print("{} cores\n\n{:>8}{:>14}{:>14}{:>14}{:>14}{:>10}\n", cores, "workers", "waiting ms", "sums ms", "predicted ms", "measured ms",
             "error");
  for (const int ranks : options.ranks) {
    const json measured = ranks == 2 ? two : run_workers(ranks, arguments, file, code);
    if (code != 0) return code;
    const double measured_s = measured.at("update_s").get<double>();
    const ScalingPrediction update = predict_update(work, link, {.workers = ranks, .per_host = ranks, .cores_per_host = cores});
    const double error = update.update_s() / measured_s - 1;
    fmt::print("{:>8}{:>14.1f}{:>14.1f}{:>14.1f}{:>14.1f}{:>9.1f}%\n", ranks, 1e3 * (update.collect_s - work.rollout_s),
               1e3 * update.reduce_s, 1e3 * update.update_s(), 1e3 * measured_s, 100 * error);
    report.add("scaling.update_ms", "ms", {1e3 * measured_s, 1e3 * measured_s, 1e3 * measured_s}, {{"workers", ranks}});
    report.add("scaling.prediction_error", "1", {error, error, error}, {{"workers", ranks}});
  }
  predict_large(options, link, report);
  report.write(options.json);
  return 0;
}

}  // namespace

void add_bench_scaling(CLI::App& bench, const std::vector<std::string>& arguments, int& exit_code) {
  const auto options = std::make_shared<BenchScalingArguments>();
  CLI::App* command = bench.add_subcommand(
      "scaling",
      "Predict training speed with more workers, and check the model with workers on this machine that sleep instead of computing");
  const auto list = [&](const char* name, std::vector<int>& values, const char* text) {
    command->add_option(name, values, text)->delimiter(',')->capture_default_str();
  };
  const auto number = [&](const char* name, auto& value, const char* text) {
    command->add_option(name, value, text)->capture_default_str();
  };
  list("--ranks", options->ranks, "Worker counts to check");
  list("--predict", options->predicted, "Worker counts to predict");
  number("--updates", options->check.updates, "Updates per worker count");
  number("--rollout-steps", options->check.rollout_steps, "Check: steps per rollout");
  number("--step-ms", options->step_ms, "Check: mean time of a step in ms; each step takes between 0 and twice this time");
  number("--spread", options->check.spread, "Check: relative standard deviation of the rollout time");
  number("--learn-ms", options->learn_ms, "Check: learning time per update in ms");
  number("--kib", options->kib, "Check and prediction: size of an all-reduce in KiB");
  number("--rollout-s", options->rollout_s, "Prediction: mean rollout time in s");
  number("--rollout-spread", options->rollout_spread, "Prediction: relative standard deviation of the rollout time");
  number("--learn-s", options->learn_s, "Prediction: learning time per update in s");
  number("--latency-us", options->latency_us, "Prediction: latency of a link with its sockets in us; 0: as measured here");
  number("--gbit-per-s", options->gbit_per_s, "Prediction: bandwidth of a link in Gbit/s; 0: as measured here");
  command->add_option("--json", options->json, "Also write names, values and settings to this JSON file")->type_name(kOutputFile);
  command->add_flag("--quick", options->quick, "Short smoke test; its numbers are not meaningful");
  command->add_option("--times", options->times, "")->group("");  // of the workers
  command->callback([options, &arguments, &exit_code] { exit_code = run(*options, arguments); });
}

}  // namespace earshot
