// SPDX-License-Identifier: Apache-2.0
// `earshot train` over MPI and Gloo gives the weights of ZeroMQ, and says in one line what cannot be.
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cstdlib>

#include "tests/support/programs/train_cli.h"
#include "tests/support/workers/host_namespaces.h"
#include "tests/support/workers/slurm_node.h"
#include "trainer/checkpoint/checkpoint_format.h"
#include "trainer/launch/transport.h"

namespace earshot {
namespace {

using testing::HasSubstr;

class TransportsCli : public TrainCli {
 protected:
  TransportsCli() {
    for (const char* name : {"OMPI_ALLOW_RUN_AS_ROOT", "OMPI_ALLOW_RUN_AS_ROOT_CONFIRM"}) ::setenv(name, "1", 1);
  }
  [[nodiscard]] Outcome in_shell(const std::string& command) const {
    const int status = std::system(("{ " + command + "; } >" + path("output") + " 2>&1 </dev/null").c_str());
    return {WIFEXITED(status) ? WEXITSTATUS(status) : -1, read_file(path("output"))};
  }
  [[nodiscard]] std::string train_in(const std::string& run, const std::string& options) const {
    return earshot_program().string() + " train " + config_ + " total_steps=48 out=" + path(run) + " " + options;
  }
  /// Hash of the weights and of what the optimizer knows at the end of the run in that folder.
  [[nodiscard]] std::uint64_t hash_of(const std::string& run) const {
    const std::string where = path(run + "/checkpoints/last.ckpt"), file = read_file(where);
    const msgpack::object_handle body = unpack_checkpoint(file, where);
    msgpack::sbuffer bytes;
    for (const char* field : {"weights", "optimizer"}) msgpack::pack(bytes, CheckpointFields(where).field(body.get(), field));
    return hash64(std::string_view(bytes.data(), bytes.size()));
  }
  [[nodiscard]] std::uint64_t hash_over_zeromq() const {
    expect_done("train " + config_ + " total_steps=48 --workers 2 out=" + path("zeromq"));
    return hash_of("zeromq");
  }
  const std::string config_ = path("tiny.yaml");
};

TEST_F(TransportsCli, MpiGivesTheWeightsOfZeroMq) {
  if (!built_transports().mpi) GTEST_SKIP() << "this build has no MPI (libopenmpi-dev was missing at configure time)";
  if (!has_program("mpirun")) GTEST_SKIP() << "mpirun is not installed (openmpi-bin)";
  expect_done("dataset episodes --config " + config_);
  const Outcome done = in_shell("mpirun -n 2 --oversubscribe " + train_in("mpi", "network.collective=mpi"));
  EXPECT_EQ(done.exit_code, 0) << done.text;
  EXPECT_THAT(done.text, HasSubstr("2 workers started by Open MPI, connected by mpi"));
  EXPECT_THAT(done.text, HasSubstr("workers are connected by mpi: network.collective is mpi"));
  EXPECT_EQ(hash_of("mpi"), hash_over_zeromq());
}

TEST_F(TransportsCli, GlooUnderTheVariablesOfTorchrunGivesTheWeightsOfZeroMq) {
  if (!built_transports().gloo) GTEST_SKIP() << "this build has no Gloo (libgloo-dev was missing at configure time)";
  expect_done("dataset episodes --config " + config_);
  const std::string port = std::to_string(free_port());
  const auto worker = [&](int rank) {
    return "env MASTER_ADDR=127.0.0.1 MASTER_PORT=" + port + " WORLD_SIZE=2 RANK=" + std::to_string(rank) +
           " OMP_NUM_THREADS=1 OPENBLAS_NUM_THREADS=1 " + train_in("gloo", "network.collective=gloo");
  };
  const Outcome done = in_shell(worker(1) + " & " + worker(0) + " && wait $!");
  EXPECT_EQ(done.exit_code, 0) << done.text;
  EXPECT_THAT(done.text, HasSubstr("2 workers started by torchrun, connected by gloo"));
  EXPECT_EQ(hash_of("gloo"), hash_over_zeromq());
  // Our own spawn has no launcher: its workers meet in a file.
  expect_done("train " + config_ + " total_steps=48 --workers 2 network.collective=gloo out=" + path("spawned"));
  EXPECT_EQ(hash_of("spawned"), hash_of("gloo"));
}

TEST_F(TransportsCli, WhatCannotBeIsRefusedInOneLine) {
  for (const std::string transport : {"mpi", "gloo"})
    expect_refused("train " + config_ + " --workers 2 network.on_loss=continue network.collective=" + transport,
                   HasSubstr("needs network.collective=zeromq: with mpi and gloo a lost worker ends the run"));
  expect_refused("train " + config_ + " --workers 2 network.collective=mpi",
                 built_transports().mpi ? HasSubstr("start the workers with mpirun -n N") : HasSubstr("install libopenmpi-dev"));
  expect_refused("train " + config_ + " --force --workers 65 network.collective=zeromq", HasSubstr("connects up to 64 workers, not 65"));
}

}  // namespace
}  // namespace earshot
