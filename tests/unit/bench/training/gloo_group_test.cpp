// SPDX-License-Identifier: Apache-2.0
#include "trainer/collective/gloo_group.h"

#include <gtest/gtest.h>

#include <chrono>
#include <cstddef>
#include <string>
#include <vector>

#include "tests/support/workers/summed_addends.h"
#include "tests/support/workers/worker_processes.h"

namespace earshot {
namespace {

TEST(Gloo, SumsAndGathersAsTheRingDoes) {
  if (!has_gloo()) GTEST_SKIP() << "built without libgloo-dev";
  const PrivateTestFolder folder;
  WorkerProcesses workers(2, [&](int rank) {
    const auto gloo = make_gloo_group({rank, 2}, (folder.path() / "meet").string(), std::chrono::seconds(30));
    std::vector<std::byte> bytes(1000, std::byte(rank + 1));
    gloo->broadcast(bytes);
    const std::string part(static_cast<std::size_t>(3 * rank), 'x');
    return sums_are_right<float>(*gloo, 100003) && sums_are_right<double>(*gloo, 5) && bytes[999] == std::byte(1) &&
           gloo->all_gather(part) == std::vector<std::string>{"", "xxx"};
  });
  workers.expect_all_succeed();
}

}  // namespace
}  // namespace earshot
