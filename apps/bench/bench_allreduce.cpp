// SPDX-License-Identifier: Apache-2.0
#include <fmt/format.h>
#include <spawn.h>
#include <sys/wait.h>
#include <unistd.h>

#include <algorithm>
#include <cerrno>
#include <cstdlib>
#include <filesystem>
#include <map>
#include <memory>
#include <nlohmann/json.hpp>
#include <string>
#include <vector>

#include "apps/commands.h"
#include "apps/options/output_options.h"
#include "bench/measure/bench_report.h"
#include "bench/training/all_reduce_speed.h"
#include "sim/base/errors.h"
#include "sim/base/files.h"
#include "sim/base/temporary_folder.h"
#include "sim/base/text/json.h"
#include "trainer/launch/transport.h"
#include "trainer/launch/worker_group.h"

namespace earshot {
namespace {

struct BenchAllreduceArguments {
  std::vector<int> ranks{2, 4};
  std::vector<double> kib{4, 16, 64, 256, 1024, 4096, 19345.52, 65536};
  std::vector<double> delays_ms{0};
  std::string json, times;
  AllReduceSpeedOptions speed;
  bool quick = false, no_gloo = false, no_mpi = false;
};

/// Work of a worker: measures with the others; rank 0 writes the times.
void measure(BenchAllreduceArguments options, const LaunchedWorker& worker) {
  options.speed.mpi = worker.has_pmix;
  const auto times = time_all_reduce(options.speed, worker.ring);
  if (worker.ring.identity.rank != 0) return;
  nlohmann::json rows = nlohmann::json::array();
  for (const AllReduceTime& time : times)
    rows.push_back({{"way", time.way}, {"bytes", time.bytes}, {"bits", time.bits_of_ring}, {"ms", time.ms}});
  write_file_atomically(options.times, json_text(rows));
}

std::string size_text(std::size_t bytes) {
  return bytes < 1'000'000 ? fmt::format("{:.4g}KB", static_cast<double>(bytes) / 1e3)
                           : fmt::format("{:.3g}MB", static_cast<double>(bytes) / 1e6);
}

std::string row(const std::vector<std::string>& cells) {
  std::string line;
  for (std::size_t i = 0; i < cells.size(); ++i) line += i == 0 ? fmt::format("{:<10}", cells[i]) : fmt::format("{:>20}", cells[i]);
  return line + "\n";
}

/// Per size a line: milliseconds of each way, those with other bits than the ring's in brackets; then over those of the libraries' own
/// sums.
std::string table(int ranks, const nlohmann::json& times, const BenchJson& setting, BenchReport& report) {
  std::vector<std::string> ways;
  std::vector<std::size_t> sizes;
  std::map<std::pair<std::size_t, std::string>, std::vector<double>> ms;
  std::map<std::pair<std::size_t, std::string>, bool> bits;
  for (const auto& time : times) {
    const auto bytes = time.at("bytes").get<std::size_t>();
    const auto way = time.at("way").get<std::string>();
    if (std::ranges::find(ways, way) == ways.end()) ways.push_back(way);
    if (std::ranges::find(sizes, bytes) == sizes.end()) sizes.push_back(bytes);
    ms[{bytes, way}] = time.at("ms").get<std::vector<double>>();
    bits[{bytes, way}] = time.at("bits").get<bool>();
  }
  const auto has = [&](const std::string& way) { return std::ranges::find(ways, way) != ways.end(); };
  std::vector<std::pair<std::string, std::string>> ratios;
  for (const char* library : {"gloo", "mpi"})
    for (const char* way : {"shared_memory", "ipc", "tcp", "gloo_ordered", "mpi_ordered"})
      if (has(library) && has(way) && (std::string(way) != "tcp" || !has("ipc"))) ratios.emplace_back(way, library);
  std::vector<std::string> head{fmt::format("{} workers", ranks)};
  for (const std::string& way : ways) head.push_back(way + " ms");
  for (const auto& [way, library] : ratios) head.push_back(fmt::format("{}/{}", way.substr(0, way.find("_memory")), library));
  std::string text = row(head);
  for (const std::size_t bytes : sizes) {
    BenchJson with_size = setting;
    with_size["ranks"] = ranks, with_size["bytes"] = bytes;
    std::vector<std::string> cells{size_text(bytes)};
    for (const std::string& way : ways) {
      const Measured time = median_of(ms[{bytes, way}]);
      report.add(fmt::format("allreduce.ms.{}", way), "ms", time, with_size);
      const bool equal = bits[{bytes, way}];
      report.add(fmt::format("allreduce.bits_of_ring.{}", way), "1", median_of({equal ? 1.0 : 0.0}), with_size);
      cells.push_back(equal ? fmt::format("{:.3f}", time.value) : fmt::format("({:.3f})", time.value));
    }
    for (const auto& [way, library] : ratios) {
      std::vector<double> of_rounds;
      for (std::size_t round = 0; round < ms[{bytes, way}].size(); ++round)
        of_rounds.push_back(ms[{bytes, way}][round] / ms[{bytes, library}][round]);
      const Measured ratio = median_of(of_rounds);
      report.add(fmt::format("allreduce.ratio_to_{}.{}", library, way), "1", ratio, with_size);
      cells.push_back(fmt::format("{:.2f}", ratio.value));
    }
    text += row(cells);
  }
  return text;
}

/// Starts the workers by mpirun, more than cores too, and waits.  Its exit code; 127 where it is not installed.
int start_by_mpirun(int ranks, const std::vector<std::string>& arguments) {
  std::vector<std::string> line{"mpirun", "-n", std::to_string(ranks), "--oversubscribe", std::filesystem::read_symlink("/proc/self/exe")};
  line.insert(line.end(), arguments.begin(), arguments.end());
  std::vector<char*> argv;
  for (std::string& word : line) argv.push_back(word.data());
  argv.push_back(nullptr);
  // A container's only user is root, whom mpirun refuses otherwise.
  for (const char* name : {"OMPI_ALLOW_RUN_AS_ROOT", "OMPI_ALLOW_RUN_AS_ROOT_CONFIRM"}) ::setenv(name, "1", 1);
  pid_t pid = -1;
  int status = 0;
  if (::posix_spawnp(&pid, argv[0], nullptr, nullptr, argv.data(), environ) != 0) return 127;
  while (::waitpid(pid, &status, 0) < 0 && errno == EINTR) {
  }
  return WIFEXITED(status) ? WEXITSTATUS(status) : 1;
}

int run(BenchAllreduceArguments options, const std::vector<std::string>& arguments) {
  require(options.speed.seconds > 0 && options.speed.seconds <= 60, "--seconds", options.speed.seconds, "must be in (0, 60]");
  require(options.speed.rounds >= 1 && options.speed.rounds <= 100, "--repeats", options.speed.rounds, "must be in [1, 100]");
  for (const int ranks : options.ranks)
    require(ranks >= 2 && ranks <= kMaxWorkers, "--ranks", ranks, fmt::format("must be 2 to {}", kMaxWorkers));
  for (const double kib : options.kib) require(kib > 0 && kib <= 1024 * 1024, "--kib", kib, "must lie in (0, 1048576]");
  for (const double delay : options.delays_ms) require(delay >= 0 && delay <= 500, "--delay-ms", delay, "must be in [0, 500]");
  if (options.quick) options.speed.seconds = 0.01, options.speed.rounds = 1, options.kib = {4, 256};
  for (const double kib : options.kib) options.speed.bytes.push_back(static_cast<std::size_t>(kib * 256) * sizeof(float));
  options.speed.gloo = !options.no_gloo;
  if (const auto worker = worker_from_environment()) {
    if (options.times.empty())
      throw InputError("bench allreduce", "starts its own workers and cannot run under a launcher",
                       "run it without srun, mpirun or torchrun");
    options.speed.delay_ms = options.delays_ms.back();  // after those of the command line
    measure(options, *worker);
    return 0;
  }

  const TemporaryFolder folder(temporary_parent(), "earshot_bench_allreduce_");
  BenchReport report("allreduce");
  if (options.speed.gloo && !built_transports().gloo)
    fmt::print("Gloo left out: it is not in this build (apt-get install libgloo-dev, then build again)\n");
  const bool mpi = !options.no_mpi && built_transports().mpi;
  if (!options.no_mpi && !mpi) fmt::print("MPI left out: it is not in this build (apt-get install libopenmpi-dev, then build again)\n");
  for (const double delay_ms : options.delays_ms)
    for (const int ranks : options.ranks) {
      const std::string file = (folder.path() / "times.json").string();
      std::vector<std::string> worker_arguments = arguments;
      worker_arguments.insert(worker_arguments.end(), {"--times", file, "--delay-ms", fmt::format("{}", delay_ms)});
      const bool by_mpirun = mpi && delay_ms == 0;
      require(by_mpirun || ranks <= kMaxMeshWorkers, "--ranks", ranks, "more than 64 need MPI and links without delay");
      if (const int code = by_mpirun ? start_by_mpirun(ranks, worker_arguments) : spawn_workers(ranks, worker_arguments); code != 0) {
        if (by_mpirun && code == 127) throw RunError("mpirun", "is not installed: install openmpi-bin, or leave MPI out by --no-mpi");
        return code;
      }
      const BenchJson setting = {{"seconds", options.speed.seconds}, {"threads", 1}, {"delay_ms", delay_ms}};
      if (delay_ms > 0) fmt::print("\n{:g} ms from host to host, a worker on each", delay_ms);
      fmt::print("\n{}", table(ranks, parse_json(read_file(file)), setting, report));
    }
  report.write(options.json);
  return 0;
}

}  // namespace

void add_bench_allreduce(CLI::App& bench, const std::vector<std::string>& arguments, int& exit_code) {
  const auto options = std::make_shared<BenchAllreduceArguments>();
  CLI::App* command = bench.add_subcommand(
      "allreduce",
      "Measure the time of an all-reduce between workers on this machine: shared memory, the ring over ipc and tcp, Gloo and MPI.\n"
      "gloo, mpi: the library's own sum; gloo_ordered, mpi_ordered: with the bits of the ring.  Sums with other bits are in brackets");
  command->add_option("--ranks", options->ranks, "Worker counts to measure")->delimiter(',')->capture_default_str();
  command->add_option("--kib", options->kib, "Sizes in KiB; 19345.52 is the gradient of the published network")
      ->delimiter(',')
      ->capture_default_str();
  command
      ->add_option(
          "--delay-ms", options->delays_ms,
          "One-way delay between workers in ms; each worker then acts as its own host (a network namespace, needs root); 0: one host")
      ->delimiter(',')
      ->capture_default_str();
  command->add_option("--seconds", options->speed.seconds, "Seconds per size, method and repeat")->capture_default_str();
  command->add_option("--repeats", options->speed.rounds, "Repeats of each measurement, interleaved")->capture_default_str();
  command->add_flag("--no-gloo", options->no_gloo, "Leave out Gloo");
  command->add_flag("--no-mpi", options->no_mpi, "Leave out MPI, which starts the workers by mpirun");
  command->add_option("--json", options->json, "Also write names, medians, ranges and settings to this JSON file")->type_name(kOutputFile);
  command->add_flag("--quick", options->quick, "Short smoke test; its numbers are not meaningful");
  command->add_option("--times", options->times, "")->group("");  // of the workers
  command->callback([options, &arguments, &exit_code] { exit_code = run(*options, arguments); });
}

}  // namespace earshot
