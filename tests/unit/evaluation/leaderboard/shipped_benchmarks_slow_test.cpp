// SPDX-License-Identifier: Apache-2.0
// configs/benchmarks: this build draws the sets that the files name.
#include <gtest/gtest.h>

#include <string>

#include "evaluation/leaderboard/benchmark.h"
#include "tests/support/envs/env_cases.h"
#include "tests/support/files/test_paths.h"

namespace earshot {
namespace {

TEST(ShippedBenchmarks, NameTheSetsThatThisBuildDraws) {
  const TestFolder folder("shipped_benchmarks");
  for (const std::string name : {"quick", "semantic", "standard"}) {
    const std::string set = (folder.path() / (name + ".json.gz")).string();
    const Benchmark benchmark = load_benchmark(source_dir() / "configs/benchmarks" / (name + ".yaml"), {"data.eval.file=" + set});
    EXPECT_FALSE(benchmark_set(benchmark).episodes.empty()) << name;
  }
}

}  // namespace
}  // namespace earshot
