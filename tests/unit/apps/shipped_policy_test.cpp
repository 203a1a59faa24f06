// SPDX-License-Identifier: Apache-2.0
// configs/policies/quick.policy, as a user runs it: a change of sensors, motion or network that the agent does not survive shows here.

#include <gtest/gtest.h>

#include <cstdlib>

#include "evaluation/results/result.h"
#include "sim/base/files.h"
#include "tests/support/envs/env_cases.h"
#include "tests/support/files/test_paths.h"

namespace earshot {
namespace {

TEST(ShippedPolicy, FindsSoundsInHousesOfItsKind) {
  const TestFolder folder("shipped_policy");
  const auto path = [&](const std::string& name) { return (folder.path() / name).string(); };
  const auto run = [&](const std::string& arguments) {
    const int status = std::system((earshot_program().string() + " " + arguments + " >" + path("log") + " 2>&1").c_str());
    EXPECT_EQ(status, 0) << arguments << "\n" << read_file(path("log"));
  };
  const std::string configs = (source_dir() / "configs").string();
  // Two of the ten held-out houses of quick.yaml with their held-out sounds, and a training set of no account.
  run("dataset episodes --config " + configs + "/train/quick.yaml --set data.train.file=" + path("train.json.gz") +
      " --set data.train.scenes=[\\\"house:1000,rooms=3,area_m2=36\\\"] --set data.eval.file=" + path("eval.json.gz") +
      " --set data.eval.scenes=[\\\"house:2000..2001,rooms=3,area_m2=36\\\"] --set data.eval.episodes_per_scene=10");
  run("eval " + configs + "/policies/quick.policy --episodes " + path("eval.json.gz") + " --out " + path("result.json"));
  const EvaluationResult result = load_result(path("result.json"));
  ASSERT_EQ(result.episodes.size(), 20u);
  double success = 0;
  for (const auto& episode : result.episodes) success += episode.metrics.success ? 1 : 0;
  // 0.95 of 300 (docs/explanation/agent.md).  Fewer than 15 of 20 has a probability of 3e-4 at that rate, and is what a deaf or blind agent
  // has.
  EXPECT_GE(success, 15);
  for (const char* part : {"compiler", "c_library", "processor", "embree", "libtorch", "onednn", "blas"})
    EXPECT_NE(result.toolchain.find(part), result.toolchain.end()) << part;
}

}  // namespace
}  // namespace earshot
