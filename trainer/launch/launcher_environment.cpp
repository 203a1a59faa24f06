// SPDX-License-Identifier: Apache-2.0
#include "trainer/launch/launcher_environment.h"

#include <fmt/format.h>
#include <unistd.h>

#include <algorithm>
#include <array>
#include <charconv>
#include <cstdlib>
#include <system_error>

#include "sim/base/errors.h"
#include "sim/base/files.h"
#include "trainer/launch/hostlist.h"
#include "trainer/launch/worker_names.h"

namespace earshot {
namespace {

constexpr std::array kNames{kRankName,
                            kWorldSizeName,
                            kRendezvousName,
                            kRunIdName,
                            "RANK",
                            "WORLD_SIZE",
                            "LOCAL_RANK",
                            "LOCAL_WORLD_SIZE",
                            "MASTER_ADDR",
                            "MASTER_PORT",
                            "TORCHELASTIC_RUN_ID",
                            "TORCHELASTIC_RESTART_COUNT",
                            "TORCHELASTIC_USE_AGENT_STORE",
                            "OMPI_COMM_WORLD_RANK",
                            "OMPI_COMM_WORLD_SIZE",
                            "OMPI_COMM_WORLD_LOCAL_SIZE",
                            "OMPI_MCA_ess_base_jobid",
                            "PMIX_RANK",
                            "PMIX_NAMESPACE",
                            "PMI_RANK",
                            "PMI_SIZE",
                            "MPI_LOCALNRANKS",
                            "SLURM_PROCID",
                            "SLURM_NTASKS",
                            "SLURM_STEP_NUM_TASKS",
                            "SLURM_STEP_ID",
                            "SLURM_JOB_ID",
                            "SLURM_RESTART_COUNT",
                            "SLURM_STEP_NODELIST",
                            "SLURM_JOB_NODELIST",
                            "SLURM_NODELIST",
                            "JOB_COMPLETION_INDEX"};

/// A value for a message: one line, not too long.
std::string shown(std::string text) {
  if (text.size() > 60) text = text.substr(0, 60) + "...";
  std::ranges::replace_if(
      text, [](char c) { return static_cast<unsigned char>(c) < 0x20 || c == 0x7F; }, '?');
  return text;
}

std::string tcp_address(const std::string& host, int port) {
  const bool ipv6 = host.find(':') != std::string::npos && !host.starts_with('[');
  return ipv6 ? fmt::format("tcp://[{}]:{}", host, port) : fmt::format("tcp://{}:{}", host, port);
}

/// The variables of one launcher.
class Table {
 public:
  Table(const Variables& variables, std::string launcher) : variables_(variables), launcher_(std::move(launcher)) {}

  [[nodiscard]] bool has(const std::string& name) const { return variables_.contains(name); }
  [[nodiscard]] std::string text(const std::string& name) const {
    const auto found = variables_.find(name);
    if (found == variables_.end())
      throw InputError(name, "is not set, although other variables of " + launcher_ + " are set",
                       "start the workers directly with the launcher");
    return found->second;
  }
  [[nodiscard]] std::string text_or(const std::string& name, const std::string& otherwise) const {
    return has(name) ? text(name) : otherwise;
  }
  [[nodiscard]] int number(const std::string& name) const {
    const std::string value = text(name);
    int result = 0;
    const auto [end, error] = std::from_chars(value.data(), value.data() + value.size(), result);
    if (error != std::errc() || end != value.data() + value.size())
      throw InputError(name + " = " + shown(value), "is not a whole number", "set it to a rank or a count");
    return result;
  }
  /// Two variables that must say the same.
  void expect_equal(const std::string& first, const std::string& other) const {
    if (has(first) && has(other) && number(first) != number(other)) refuse_both(first, other);
  }
  [[noreturn]] void refuse_both(const std::string& first, const std::string& other) const {
    throw InputError(fmt::format("{} = {}", first, shown(text(first))), fmt::format("contradicts {} = {}", other, shown(text(other))),
                     "unset the variable that belongs to another launcher");
  }

 private:
  const Variables& variables_;
  std::string launcher_;
};

/// Values of a launcher; missing ones stay empty.
struct Said {
  std::string launcher;
  WorkerIdentity identity;
  std::string rank_name, size_name;  ///< variables, for messages
  bool one_host = false;
  std::string host;  ///< of rank 0
  int port = 0;      ///< 0: any in the range that is a function of the run id
  std::string run_id;
};

Said from_torchrun(const Variables& variables) {
  const Table table(variables, "torchrun");
  Said said{"torchrun", {table.number("RANK"), table.number("WORLD_SIZE")}, "RANK", "WORLD_SIZE", false, {}, 0, {}};
  if (table.has("LOCAL_WORLD_SIZE")) {
    const int local = table.number("LOCAL_WORLD_SIZE");
    if (local > said.identity.world_size) table.refuse_both("LOCAL_WORLD_SIZE", "WORLD_SIZE");
    if (table.has("LOCAL_RANK") && table.number("LOCAL_RANK") >= local) table.refuse_both("LOCAL_RANK", "LOCAL_WORLD_SIZE");
    said.one_host = local == said.identity.world_size;
  }
  said.host = table.text("MASTER_ADDR");
  said.port = table.number("MASTER_PORT");
  require(said.port > 0 && said.port < 65535, "MASTER_PORT", said.port, "must be in [1, 65534]");
  // torchrun's agent may keep a store of its own at that port.
  if (table.text_or("TORCHELASTIC_USE_AGENT_STORE", "") == "True") ++said.port;
  said.run_id = fmt::format("torchrun {} {}:{}", table.text_or("TORCHELASTIC_RUN_ID", "-"), said.host, said.port);
  // Each agent counts its own restarts: where several have started the workers, the counts may differ.
  if (said.one_host) said.run_id += " " + table.text_or("TORCHELASTIC_RESTART_COUNT", "0");
  return said;
}

Said from_open_mpi(const Variables& variables) {
  const Table table(variables, "Open MPI");
  Said said{"Open MPI",
            {table.number("OMPI_COMM_WORLD_RANK"), table.number("OMPI_COMM_WORLD_SIZE")},
            "OMPI_COMM_WORLD_RANK",
            "OMPI_COMM_WORLD_SIZE",
            false,
            {},
            0,
            {}};
  table.expect_equal("OMPI_COMM_WORLD_RANK", "PMIX_RANK");
  if (table.has("OMPI_COMM_WORLD_LOCAL_SIZE")) {
    const int local = table.number("OMPI_COMM_WORLD_LOCAL_SIZE");
    if (local > said.identity.world_size) table.refuse_both("OMPI_COMM_WORLD_LOCAL_SIZE", "OMPI_COMM_WORLD_SIZE");
    said.one_host = local == said.identity.world_size;
  }
  const std::string job = table.text_or("PMIX_NAMESPACE", table.text_or("OMPI_MCA_ess_base_jobid", ""));
  if (!job.empty()) said.run_id = "mpirun " + job;
  return said;
}

Said from_hydra(const Variables& variables) {
  const Table table(variables, "MPICH");
  Said said{"MPICH", {table.number("PMI_RANK"), table.number("PMI_SIZE")}, "PMI_RANK", "PMI_SIZE", false, {}, 0, {}};
  said.one_host = table.has("MPI_LOCALNRANKS") && table.number("MPI_LOCALNRANKS") == said.identity.world_size;
  return said;
}

Said from_slurm(const Variables& variables) {
  const Table table(variables, "Slurm");
  const std::string size = table.has("SLURM_STEP_NUM_TASKS") ? "SLURM_STEP_NUM_TASKS" : "SLURM_NTASKS";
  Said said{"Slurm", {table.number("SLURM_PROCID"), table.number(size)}, "SLURM_PROCID", size, false, {}, 0, {}};
  said.run_id =
      fmt::format("slurm {}.{}.{}", table.text("SLURM_JOB_ID"), table.text("SLURM_STEP_ID"), table.text_or("SLURM_RESTART_COUNT", "0"));
  for (const char* name : {"SLURM_STEP_NODELIST", "SLURM_JOB_NODELIST", "SLURM_NODELIST"}) {
    if (!table.has(name)) continue;
    const auto hosts = expand_hostlist(table.text(name));
    said.host = hosts.front();
    said.one_host = hosts.size() == 1;
    return said;
  }
  throw InputError("SLURM_STEP_NODELIST", "is not set, although other variables of Slurm are set", "start the workers with srun");
}

Said from_kubernetes(const Variables& variables) {
  const Table table(variables, "Kubernetes");
  Said said{"Kubernetes", {table.number("JOB_COMPLETION_INDEX"), 0}, "JOB_COMPLETION_INDEX", kWorldSizeName, false, {}, 0, {}};
  if (!table.has(kWorldSizeName))
    throw InputError("JOB_COMPLETION_INDEX",
                     "is set (an indexed job of Kubernetes), but EARSHOT_WORLD_SIZE is not, and Kubernetes does not set the number of pods",
                     "set EARSHOT_WORLD_SIZE to the completions of the job, or to 1 if every pod trains alone");
  said.identity.world_size = table.number(kWorldSizeName);
  return said;
}

std::optional<Said> from_launcher(const Variables& variables) {
  const auto has = [&](const char* name) { return variables.contains(name); };
  // RANK and WORLD_SIZE are common words: only together with where to meet are they torchrun's.
  if (has("MASTER_ADDR") && (has("RANK") || has("WORLD_SIZE"))) return from_torchrun(variables);
  if (has("OMPI_COMM_WORLD_RANK") || has("OMPI_COMM_WORLD_SIZE")) return from_open_mpi(variables);
  // srun sets PMI_RANK too, for programs that would use it; MPI_LOCALNRANKS only Hydra does.
  const bool slurm = has("SLURM_STEP_ID") && has("SLURM_PROCID");
  if (has("PMI_RANK") && has("PMI_SIZE") && (has("MPI_LOCALNRANKS") || !slurm)) return from_hydra(variables);
  if (slurm) return from_slurm(variables);
  if (has("JOB_COMPLETION_INDEX")) return from_kubernetes(variables);
  return std::nullopt;
}

/// A folder that all workers of this user and run name alike.
std::filesystem::path meeting_folder(const std::string& run_id) {
  return parent_of_sockets() / fmt::format("earshot-{}-{}", ::geteuid(), hex64(hash64(run_id, 0)));
}

}  // namespace

std::optional<LaunchedWorker> worker_from(const Variables& variables, int first_port, int last_port, Transport collective) {
  const Table earshot_variables(variables, "Earshot");
  const bool complete = earshot_variables.has(kRankName) && earshot_variables.has(kWorldSizeName) &&
                        earshot_variables.has(kRendezvousName) && earshot_variables.has(kRunIdName);
  LaunchedWorker worker;
  if (complete) {
    worker.launcher = kRankName;
    worker.ring.identity = {earshot_variables.number(kRankName), earshot_variables.number(kWorldSizeName)};
    worker.ring.rendezvous = earshot_variables.text(kRendezvousName);
    worker.ring.run_id = earshot_variables.text(kRunIdName);
    return worker;
  }
  const auto said = from_launcher(variables);
  if (!said) {
    for (const char* name : {kRankName, kWorldSizeName, kRendezvousName, kRunIdName})
      for (const char* other : {kRankName, kWorldSizeName, kRendezvousName, kRunIdName})
        if (earshot_variables.has(name) && !earshot_variables.has(other))
          throw InputError(other, fmt::format("is not set, although {} is set and no launcher was found", name),
                           "set all of EARSHOT_RANK, EARSHOT_WORLD_SIZE, EARSHOT_RENDEZVOUS and EARSHOT_RUN_ID, or none of them");
    return std::nullopt;
  }
  earshot_variables.expect_equal(kRankName, said->rank_name);
  earshot_variables.expect_equal(kWorldSizeName, said->size_name);
  const auto [rank, world_size] = said->identity;
  require(world_size >= 1, said->size_name, world_size, "must be at least 1");
  require(rank >= 0 && rank < world_size, said->rank_name, rank,
          fmt::format("must be within 0 to {}: {} = {}", world_size - 1, said->size_name, world_size));
  if (world_size == 1) return std::nullopt;

  worker.launcher = said->launcher;
  worker.has_pmix = variables.contains("PMIX_RANK") && variables.contains("PMIX_NAMESPACE");
  worker.ring.identity = said->identity;
  worker.ring.run_id = earshot_variables.has(kRunIdName) ? earshot_variables.text(kRunIdName) : said->run_id;
  worker.ring.start_id = said->run_id;
  if (worker.ring.run_id.empty())
    throw InputError(kRunIdName, fmt::format("is not set, and {} provides no job id", said->launcher),
                     "set EARSHOT_RUN_ID to a text that is the same in all workers of this run and different in every other run");
  if (earshot_variables.has(kRendezvousName)) {
    worker.ring.rendezvous = earshot_variables.text(kRendezvousName);
  } else if (said->one_host) {
    worker.folder = meeting_folder(worker.ring.run_id);
    worker.ring.rendezvous = fmt::format("ipc://{}", (worker.folder / "meet").string());
  } else if (!said->host.empty()) {
    const auto num_ports = static_cast<std::uint64_t>(last_port - first_port + 1);
    const int port = said->port > 0 ? said->port : first_port + static_cast<int>(hash64(worker.ring.run_id, 1) % num_ports);
    worker.ring.rendezvous = tcp_address(said->host, port);
  } else if (!worker.has_pmix || !(collective == Transport::mpi || (collective == Transport::automatic && world_size > kMaxMeshWorkers))) {
    throw InputError(kRendezvousName, fmt::format("is not set, and {} does not provide the address of rank 0", said->launcher),
                     "set EARSHOT_RENDEZVOUS=tcp://HOST:PORT in all workers, with the host of rank 0");
  }
  return worker;
}

Variables launcher_variables() {
  Variables variables;
  for (const char* name : kNames)
    if (const char* value = std::getenv(name)) variables[name] = value;
  return variables;
}

}  // namespace earshot
