// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <gtest/gtest.h>
#include <unistd.h>

#include <cstdint>
#include <filesystem>
#include <map>
#include <memory>
#include <string>
#include <vector>

#include "sim/base/random.h"
#include "tests/support/envs/env_fixture.h"

/// Environments that hear through source fields.
namespace earshot::field_envs {

inline EnvConfig field_config() {
  EnvConfig config = quick_env_config();
  config.acoustics.field = Switch::on;
  config.acoustics.field_photons = 2048;
  config.acoustics.field_error = 1.f;
  return config;
}

class FieldEnv : public testing::Test {
 protected:
  void SetUp() override {
    folder_ = std::filesystem::temp_directory_path() /
              ("earshot_env_" + std::string(testing::UnitTest::GetInstance()->current_test_info()->name()) + std::to_string(::getpid()));
    std::filesystem::remove_all(folder_);
  }
  void TearDown() override { std::filesystem::remove_all(folder_); }
  std::filesystem::path folder_;
};

/// What is heard and rewarded in each step, by global env id.
using Heard = std::map<int, std::vector<float>>;

inline void record(const BatchedEnv& env, int first, Heard& out) {
  for (int row = 0; row < env.num_envs(); ++row)
    for (const auto rows : {float_rows(env, "heard"), float_rows(env, "spectrogram"), env.rewards()}) {
      const std::size_t size = rows.size() / static_cast<std::size_t>(env.num_envs());
      const auto mine = rows.subspan(static_cast<std::size_t>(row) * size, size);
      out[first + row].insert(out[first + row].end(), mine.begin(), mine.end());
    }
}

inline void step(BatchedEnv& env, int first, int index) {
  std::vector<std::int32_t> actions;
  for (int i = 0; i < env.num_envs(); ++i) {
    const float u = RandomStream(3, Purpose::test, static_cast<std::uint32_t>(first + i), static_cast<std::uint32_t>(index)).uniform(0);
    actions.push_back(u < 0.1f ? 0 : u < 0.6f ? 1 : u < 0.8f ? 2 : 3);
  }
  env.step(actions);
}

inline Heard roll_out(const EnvConfig& config, const std::shared_ptr<SceneCache>& scenes, const std::vector<int>& batches, int steps = 17) {
  static const auto set = quick_set(1);
  Heard out;
  int first = 0;
  for (const int size : batches) {
    BatchedEnv env(config, set, scenes, size, first, 4);
    env.reset();
    record(env, first, out);
    for (int i = 0; i < steps; ++i) {
      step(env, first, i);
      record(env, first, out);
    }
    EXPECT_EQ(env.quarantine_counters().nonfinite(), 0u);
    first += size;
  }
  return out;
}

}  // namespace earshot::field_envs
