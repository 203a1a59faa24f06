// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <gtest/gtest.h>

#include <cstdint>
#include <map>
#include <memory>
#include <span>
#include <utility>
#include <vector>

#include "envs/batch/batched_env.h"
#include "sim/base/random.h"

/// Everything that a batch shows over a number of steps, to be compared bit for bit.
namespace earshot::roll_outs {

/// Everything an env gives out in one step, by global env id.
struct Record {
  std::vector<float> values;
  std::vector<std::uint8_t> flags;
  friend bool operator==(const Record&, const Record&) = default;
};

template <class T>
void append_row(std::vector<T>& out, std::span<const T> rows, std::size_t row, std::size_t count) {
  const std::size_t size = rows.size() / count;
  out.insert(out.end(), rows.begin() + static_cast<std::ptrdiff_t>(row * size),
             rows.begin() + static_cast<std::ptrdiff_t>((row + 1) * size));
}

inline void record(const BatchedEnv& env, int first, std::map<int, std::vector<Record>>& out) {
  const auto count = static_cast<std::size_t>(env.num_envs());
  for (std::size_t row = 0; row < count; ++row) {
    Record now;
    for (const auto rows : {float_rows(env, "depth"), float_rows(env, "spectrogram"), float_rows(env, "waveform"), float_rows(env, "heard"),
                            float_rows(env, "pointgoal"), env.rewards(), final_float_rows(env, "depth"),
                            final_float_rows(env, "spectrogram"), final_float_rows(env, "pointgoal")})
      append_row(now.values, rows, row, count);
    for (const auto rows : {env.terminated(), env.truncated(), env.active(), env.collided()}) append_row(now.flags, rows, row, count);
    out[first + static_cast<int>(row)].push_back(std::move(now));
  }
}

/// Mostly forward, some turns, a stop now and then: episodes end both ways.
inline std::int32_t test_action(int global_env, int step) {
  const float u = RandomStream(3, Purpose::test, static_cast<std::uint32_t>(global_env), static_cast<std::uint32_t>(step)).uniform(0);
  return u < 0.05f ? 0 : u < 0.6f ? 1 : u < 0.8f ? 2 : 3;
}

inline void step(BatchedEnv& env, int first, int step_index) {
  std::vector<std::int32_t> actions;
  for (int i = 0; i < env.num_envs(); ++i) actions.push_back(test_action(first + i, step_index));
  env.step(actions);
}

/// Rolls out envs 0 ... 5 in batches of the given sizes.
inline std::map<int, std::vector<Record>> roll_out(const EnvConfig& config, const std::shared_ptr<const EpisodeSet>& set,
                                                   const std::shared_ptr<SceneCache>& scenes, const std::vector<int>& batches, int steps) {
  std::map<int, std::vector<Record>> out;
  int first = 0;
  for (const int size : batches) {
    BatchedEnv env(config, set, scenes, size, first, 6);
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

}  // namespace earshot::roll_outs
