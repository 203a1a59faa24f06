// SPDX-License-Identifier: Apache-2.0
// mpi_rank SCENARIO FOLDER: one rank of tests/unit/trainer/collective/mpi_collective_test.cpp, started by mpirun.  Leaves the file
// as_expected.RANK in the folder if all was.  Without libtorch, so that hundreds fit on a machine.
#include <cstdlib>
#include <fstream>

#include "tests/support/workers/exchange_scenarios.h"
#include "trainer/collective/mpi/mpi_exchange.h"
#include "trainer/launch/launcher_environment.h"

int main(int argc, char** argv) {
  using namespace earshot;
  if (argc != 3) return 2;
  ::alarm(600);
  try {
    auto worker = worker_from(launcher_variables(), 20000, 29999, Transport::mpi);
    RingConfig ring = worker ? worker->ring : RingConfig{};
    const std::filesystem::path folder = argv[2];
    ExchangeScenarios scenarios(ring.identity, folder, [&](std::chrono::milliseconds timeout) {
      ring.timeout = timeout;
      return make_ordered_collective(join_mpi(ring));
    });
    if (!scenarios.run(argv[1])) {
      std::fprintf(stderr, "rank %d: not as expected\n", ring.identity.rank);
      return 1;
    }
    std::ofstream(folder / ("as_expected." + std::to_string(ring.identity.rank))).put('x');  // again, where the scenario has said so
    return 0;
  } catch (const std::exception& error) {
    std::fprintf(stderr, "%s\n", error.what());
    return 1;
  }
}
