// SPDX-License-Identifier: Apache-2.0
// configs/benchmarks: files whose hashes are those of what they say.
#include <gtest/gtest.h>

#include <string>

#include "evaluation/leaderboard/benchmark.h"
#include "tests/support/files/test_paths.h"

namespace earshot {
namespace {

TEST(ShippedBenchmarks, HoldTheHashesOfTheirRulesAndSenses) {
  for (const std::string name : {"quick", "semantic", "standard"}) {
    const Benchmark benchmark = load_benchmark(source_dir() / "configs/benchmarks" / (name + ".yaml"));
    EXPECT_EQ(benchmark.name, name);
    EXPECT_EQ(benchmark.tracks.size(), 3u) << name;
  }
}

}  // namespace
}  // namespace earshot
