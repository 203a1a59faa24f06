// SPDX-License-Identifier: Apache-2.0
#include "trainer/launch/launcher_environment.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <unistd.h>

#include "sim/base/errors.h"
#include "trainer/net/rendezvous.h"

namespace earshot {
namespace {

using testing::AllOf;
using testing::HasSubstr;
using testing::MatchesRegex;
using testing::StartsWith;

// What each launcher sets, by `env` in its processes (Slurm 22.05, Open MPI 4.1.4, torchrun 1.13, the others by their documentation).
const Variables kOwn = {
    {"EARSHOT_RANK", "1"}, {"EARSHOT_WORLD_SIZE", "2"}, {"EARSHOT_RENDEZVOUS", "tcp://127.0.0.1:5555"}, {"EARSHOT_RUN_ID", "own"}};
const Variables kTorchrun = {{"RANK", "3"},
                             {"WORLD_SIZE", "4"},
                             {"LOCAL_RANK", "1"},
                             {"LOCAL_WORLD_SIZE", "2"},
                             {"MASTER_ADDR", "10.1.0.1"},
                             {"MASTER_PORT", "29500"},
                             {"TORCHELASTIC_RUN_ID", "exp"},
                             {"TORCHELASTIC_RESTART_COUNT", "1"},
                             {"TORCHELASTIC_USE_AGENT_STORE", "True"}};
const Variables kOpenMpi = {{"OMPI_COMM_WORLD_RANK", "1"},       {"OMPI_COMM_WORLD_SIZE", "2"},
                            {"OMPI_COMM_WORLD_LOCAL_SIZE", "2"}, {"PMIX_RANK", "1"},
                            {"PMIX_NAMESPACE", "3234"},          {"OMPI_MCA_ess_base_jobid", "3234"}};
const Variables kHydra = {{"PMI_RANK", "1"}, {"PMI_SIZE", "3"}, {"MPI_LOCALNRANKS", "3"}, {"EARSHOT_RUN_ID", "mpich"}};
const Variables kSlurm = {{"SLURM_PROCID", "5"},  {"SLURM_NTASKS", "8"},          {"SLURM_STEP_NUM_TASKS", "8"},
                          {"SLURM_STEP_ID", "0"}, {"SLURM_JOB_ID", "77"},         {"SLURM_STEP_NODELIST", "n[07-08]"},
                          {"PMI_RANK", "5"},      {"SLURM_NODELIST", "n[07-09]"}, {"PMI_SIZE", "8"}};
const Variables kKubernetes = {{"JOB_COMPLETION_INDEX", "2"},
                               {"EARSHOT_WORLD_SIZE", "4"},
                               {"EARSHOT_RENDEZVOUS", "tcp://train-0.train:29400"},
                               {"EARSHOT_RUN_ID", "uid"}};

Variables with(Variables variables, const Variables& changes) {
  for (const auto& [name, value] : changes) {
    if (value == "unset")
      variables.erase(name);
    else
      variables[name] = value;
  }
  return variables;
}

LaunchedWorker worker_of(const Variables& variables) {
  const auto worker = worker_from(variables);
  if (!worker) throw std::logic_error("no table was found");
  return *worker;
}

std::string refusal_of(const Variables& variables) {
  try {
    const auto worker = worker_from(variables);
    return worker ? "taken for " + worker->launcher : "taken for a process on its own";
  } catch (const InputError& error) {
    return error.what();
  }
}

void expect_identity(const LaunchedWorker& worker, const char* launcher, int rank, int world_size) {
  EXPECT_EQ(worker.launcher, launcher);
  EXPECT_EQ(worker.ring.identity.rank, rank);
  EXPECT_EQ(worker.ring.identity.world_size, world_size);
}

TEST(LauncherEnvironment, SaysWhatMpiAndGlooMeetBy) {
  // Restarts under one run id meet in one folder, each with a file of Gloo of its own.
  const Variables named = with(kOpenMpi, {{"EARSHOT_RUN_ID", "all starts"}}), restarted = with(named, {{"PMIX_NAMESPACE", "3235"}});
  EXPECT_EQ(worker_of(named).folder, worker_of(restarted).folder);
  EXPECT_NE(worker_of(named).ring.start_id, worker_of(restarted).ring.start_id);
  EXPECT_EQ(worker_of(kOwn).ring.start_id, "");
  EXPECT_TRUE(worker_of(kOpenMpi).has_pmix);
  EXPECT_FALSE(worker_of(kSlurm).has_pmix);
  EXPECT_TRUE(worker_of(with(kSlurm, {{"PMIX_RANK", "5"}, {"PMIX_NAMESPACE", "slurm.pmix.77.0"}})).has_pmix);
  // MPI finds the ranks of several hosts by itself.
  const Variables hosts = with(kOpenMpi, {{"OMPI_COMM_WORLD_LOCAL_SIZE", "1"}});
  EXPECT_EQ(worker_from(hosts, 20000, 29999, Transport::mpi)->ring.rendezvous, "");
  EXPECT_THROW(worker_from(hosts, 20000, 29999, Transport::automatic), InputError);
  const Variables many = with(hosts, {{"OMPI_COMM_WORLD_SIZE", "65"}});
  EXPECT_EQ(worker_from(many, 20000, 29999, Transport::automatic)->ring.rendezvous, "");
}

TEST(LauncherEnvironment, ReadsEveryTable) {
  expect_identity(worker_of(kOwn), "EARSHOT_RANK", 1, 2);
  EXPECT_EQ(worker_of(kOwn).ring.rendezvous, "tcp://127.0.0.1:5555");
  EXPECT_EQ(worker_of(kOwn).ring.run_id, "own");

  expect_identity(worker_of(kTorchrun), "torchrun", 3, 4);
  EXPECT_EQ(worker_of(kTorchrun).ring.rendezvous, "tcp://10.1.0.1:29501") << "29500 is the agent's own store";
  EXPECT_EQ(worker_of(with(kTorchrun, {{"TORCHELASTIC_USE_AGENT_STORE", "False"}})).ring.rendezvous, "tcp://10.1.0.1:29500");
  EXPECT_EQ(worker_of(with(kTorchrun, {{"MASTER_ADDR", "fd00::1"}})).ring.rendezvous, "tcp://[fd00::1]:29501");
  for (const char* loopback : {"::1", "[::1]"})
    EXPECT_EQ(worker_of(with(kTorchrun, {{"MASTER_ADDR", loopback}})).ring.rendezvous, "tcp://[::1]:29501");
  EXPECT_EQ(worker_of(with(kTorchrun, {{"MASTER_ADDR", "localhost"}})).ring.rendezvous, "tcp://localhost:29501");

  expect_identity(worker_of(kOpenMpi), "Open MPI", 1, 2);
  expect_identity(worker_of(kHydra), "MPICH", 1, 3);
  expect_identity(worker_of(kSlurm), "Slurm", 5, 8);
  EXPECT_THAT(worker_of(kSlurm).ring.rendezvous, MatchesRegex("tcp://n07:2[0-9][0-9][0-9][0-9]")) << "first host of the step";

  expect_identity(worker_of(kKubernetes), "Kubernetes", 2, 4);
  EXPECT_EQ(worker_of(kKubernetes).ring.rendezvous, "tcp://train-0.train:29400");
}

TEST(LauncherEnvironment, RanksOfOneHostMeetInAFolderOfTheirUser) {
  const Variables one_node = with(kSlurm, {{"SLURM_STEP_NODELIST", "n07"}});
  for (const Variables& variables : {kOpenMpi, kHydra, one_node, with(kTorchrun, {{"LOCAL_WORLD_SIZE", "4"}})}) {
    const LaunchedWorker worker = worker_of(variables);
    EXPECT_EQ(worker.ring.rendezvous, "ipc://" + worker.folder.string() + "/meet");
    EXPECT_THAT(worker.folder.filename().string(), StartsWith("earshot-" + std::to_string(::geteuid()) + "-"));
  }
  // Alike for all ranks of a run and for no other.
  EXPECT_EQ(worker_of(kOpenMpi).folder, worker_of(with(kOpenMpi, {{"OMPI_COMM_WORLD_RANK", "0"}, {"PMIX_RANK", "0"}})).folder);
  EXPECT_NE(worker_of(kOpenMpi).folder, worker_of(with(kOpenMpi, {{"PMIX_NAMESPACE", "3235"}})).folder);
  EXPECT_NE(worker_of(one_node).folder, worker_of(with(one_node, {{"SLURM_STEP_ID", "1"}})).folder);
  EXPECT_NE(worker_of(one_node).folder, worker_of(with(one_node, {{"SLURM_RESTART_COUNT", "1"}})).folder) << "a requeued job";
}

// Each agent counts its own restarts.  Workers of several agents have to name their run alike all the same.
TEST(LauncherEnvironment, TheNameOfARunOfSeveralAgentsHasNoCountOfRestarts) {
  const auto again = [](const Variables& variables, const char* count) {
    return worker_of(with(variables, {{"TORCHELASTIC_RESTART_COUNT", count}})).ring.run_id;
  };
  EXPECT_EQ(again(kTorchrun, "0"), again(kTorchrun, "3"));
  const Variables one_host = with(kTorchrun, {{"LOCAL_WORLD_SIZE", "4"}});
  EXPECT_NE(again(one_host, "0"), again(one_host, "3"));
  EXPECT_NE(again(kTorchrun, "0"), again(with(kTorchrun, {{"MASTER_PORT", "29502"}}), "0"));
}

TEST(LauncherEnvironment, PortOfAMeetingPointIsAFunctionOfTheRunWithinItsRange) {
  for (int job = 0; job < 50; ++job) {
    const Variables variables = with(kSlurm, {{"SLURM_JOB_ID", std::to_string(job)}});
    const std::string address = worker_from(variables, 4000, 4009)->ring.rendezvous;
    EXPECT_THAT(address, MatchesRegex("tcp://n07:400[0-9]"));
    EXPECT_EQ(address, worker_from(with(variables, {{"SLURM_PROCID", "0"}}), 4000, 4009)->ring.rendezvous);
  }
  EXPECT_EQ(worker_from(kSlurm, 4000, 4000)->ring.rendezvous, "tcp://n07:4000");
}

TEST(LauncherEnvironment, InnerLaunchersComeBeforeOuterOnes) {
  // srun torchrun; mpirun and Hydra in a Slurm job; an indexed job that starts torchrun or mpirun; our own spawn in any.
  Variables all = with(kSlurm, kKubernetes);
  for (const char* name : {"EARSHOT_WORLD_SIZE", "EARSHOT_RENDEZVOUS", "EARSHOT_RUN_ID"}) all.erase(name);
  EXPECT_EQ(worker_of(all).launcher, "Slurm");
  EXPECT_EQ(worker_of(with(all, kHydra)).launcher, "MPICH");
  EXPECT_EQ(worker_of(with(all, kOpenMpi)).launcher, "Open MPI");
  EXPECT_EQ(worker_of(with(with(all, kOpenMpi), kTorchrun)).launcher, "torchrun");
  EXPECT_EQ(worker_of(with(with(all, kTorchrun), kOwn)).launcher, "EARSHOT_RANK");
}

TEST(LauncherEnvironment, OwnVariablesCompleteALaunchersTable) {
  const LaunchedWorker worker = worker_of(with(kOpenMpi, {{"EARSHOT_RENDEZVOUS", "tcp://h:7000"}, {"EARSHOT_RUN_ID", "mine"}}));
  expect_identity(worker, "Open MPI", 1, 2);
  EXPECT_EQ(worker.ring.rendezvous, "tcp://h:7000");
  EXPECT_EQ(worker.ring.run_id, "mine");
  EXPECT_TRUE(worker.folder.empty());
  EXPECT_NO_THROW(worker_of(with(kOpenMpi, {{"EARSHOT_RANK", "1"}, {"EARSHOT_WORLD_SIZE", "2"}})));
}

TEST(LauncherEnvironment, OneProcessIsOnItsOwn) {
  EXPECT_FALSE(worker_from({}));
  EXPECT_FALSE(worker_from({{"RANK", "7"}, {"WORLD_SIZE", "99"}})) << "common words";
  // A shell of salloc and the script of sbatch: an allocation, but no step.
  EXPECT_FALSE(worker_from(with(kSlurm, {{"SLURM_STEP_ID", "unset"}, {"PMI_RANK", "unset"}, {"PMI_SIZE", "unset"}})));
  EXPECT_FALSE(worker_from(with(kSlurm, {{"SLURM_STEP_NUM_TASKS", "1"}, {"SLURM_PROCID", "0"}})));
  EXPECT_FALSE(worker_from(with(
      kOpenMpi, {{"OMPI_COMM_WORLD_SIZE", "1"}, {"OMPI_COMM_WORLD_LOCAL_SIZE", "1"}, {"OMPI_COMM_WORLD_RANK", "0"}, {"PMIX_RANK", "0"}})));
  EXPECT_FALSE(worker_from({{"JOB_COMPLETION_INDEX", "0"}, {"EARSHOT_WORLD_SIZE", "1"}}));
}

TEST(LauncherEnvironment, ContradictionsAreRefusedInOneLine) {
  const std::vector<std::tuple<Variables, std::string, std::string>> cases = {
      {with(kOwn, {{"EARSHOT_RUN_ID", "unset"}}), "EARSHOT_RUN_ID", "no launcher"},
      {with(kOwn, {{"EARSHOT_RANK", "1x"}}), "EARSHOT_RANK = 1x", "whole number"},
      {with(kOwn, {{"EARSHOT_RANK", ""}}), "EARSHOT_RANK", "whole number"},
      {with(kOwn, {{"EARSHOT_RANK", "99999999999"}}), "EARSHOT_RANK", "whole number"},
      {with(kTorchrun, {{"RANK", "4"}}), "RANK = 4", "WORLD_SIZE = 4"},
      {with(kTorchrun, {{"RANK", "-1"}}), "RANK = -1", "within 0 to 3"},
      {with(kTorchrun, {{"RANK", "one\ntwo"}}), "RANK = one?two", "whole number"},
      {with(kTorchrun, {{"WORLD_SIZE", "unset"}}), "WORLD_SIZE", "is not set"},
      {with(kTorchrun, {{"WORLD_SIZE", "0"}, {"LOCAL_WORLD_SIZE", "unset"}}), "WORLD_SIZE = 0", "at least 1"},
      {with(kTorchrun, {{"LOCAL_WORLD_SIZE", "8"}}), "LOCAL_WORLD_SIZE = 8", "contradicts WORLD_SIZE = 4"},
      {with(kTorchrun, {{"LOCAL_RANK", "2"}}), "LOCAL_RANK = 2", "contradicts LOCAL_WORLD_SIZE = 2"},
      {with(kTorchrun, {{"MASTER_PORT", "70000"}}), "MASTER_PORT = 70000", "65534"},
      {with(kOpenMpi, {{"PMIX_RANK", "0"}}), "OMPI_COMM_WORLD_RANK = 1", "contradicts PMIX_RANK = 0"},
      {with(kOpenMpi, {{"OMPI_COMM_WORLD_SIZE", "unset"}}), "OMPI_COMM_WORLD_SIZE", "is not set"},
      {with(kOpenMpi, {{"OMPI_COMM_WORLD_LOCAL_SIZE", "3"}}), "OMPI_COMM_WORLD_LOCAL_SIZE = 3", "contradicts"},
      {with(kOpenMpi, {{"OMPI_COMM_WORLD_LOCAL_SIZE", "1"}}), "EARSHOT_RENDEZVOUS", "the address of rank 0"},
      {with(kOpenMpi, {{"EARSHOT_WORLD_SIZE", "3"}}), "EARSHOT_WORLD_SIZE = 3", "contradicts OMPI_COMM_WORLD_SIZE = 2"},
      {with(kOpenMpi, {{"EARSHOT_RANK", "0"}}), "EARSHOT_RANK = 0", "contradicts OMPI_COMM_WORLD_RANK = 1"},
      {with(kHydra, {{"EARSHOT_RUN_ID", "unset"}}), "EARSHOT_RUN_ID", "provides no job id"},
      {with(kSlurm, {{"SLURM_PROCID", "8"}}), "SLURM_PROCID = 8", "SLURM_STEP_NUM_TASKS = 8"},
      {with(kSlurm, {{"SLURM_JOB_ID", "unset"}}), "SLURM_JOB_ID", "is not set"},
      {with(kSlurm, {{"SLURM_STEP_NODELIST", "n[7-"}}), "host list 'n[7-'", "number"},
      {with(kSlurm, {{"SLURM_STEP_NODELIST", "unset"}, {"SLURM_NODELIST", "unset"}}), "SLURM_STEP_NODELIST", "is not set"},
      {with(kKubernetes, {{"EARSHOT_WORLD_SIZE", "unset"}}), "JOB_COMPLETION_INDEX", "EARSHOT_WORLD_SIZE"},
      {with(kKubernetes, {{"JOB_COMPLETION_INDEX", "4"}}), "JOB_COMPLETION_INDEX = 4", "EARSHOT_WORLD_SIZE = 4"},
      {with(kKubernetes, {{"EARSHOT_RENDEZVOUS", "unset"}}), "EARSHOT_RENDEZVOUS", "the address of rank 0"},
  };
  for (const auto& [variables, where, problem] : cases) {
    const std::string refusal = refusal_of(variables);
    EXPECT_THAT(refusal, AllOf(HasSubstr(where), HasSubstr(problem)));
    EXPECT_EQ(refusal.find('\n'), std::string::npos);
  }
}

}  // namespace
}  // namespace earshot
