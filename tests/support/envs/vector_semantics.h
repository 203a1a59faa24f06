// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <gtest/gtest.h>

#include <memory>
#include <vector>

#include "tests/support/envs/env_cases.h"
#include "tests/support/envs/env_roll_out.h"

namespace earshot {

using roll_outs::test_action;

/// All that a policy may read of an env.
inline std::vector<std::byte> shown(const BatchedEnv& env, int row) {
  std::vector<std::byte> all;
  const auto count = static_cast<std::size_t>(env.num_envs());
  for (const SensorSpec& sensor : env.sensors())
    for (const auto rows : {env.rows(sensor.name), env.final_rows(sensor.name)})
      roll_outs::append_row(all, rows, static_cast<std::size_t>(row), count);
  const auto i = static_cast<std::size_t>(row);
  for (const std::uint8_t flag : {env.terminated()[i], env.truncated()[i], env.active()[i], env.collided()[i], env.quarantined()[i]})
    all.push_back(static_cast<std::byte>(flag));
  const float reward = env.rewards()[i];
  const auto bytes = std::as_bytes(std::span(&reward, 1));
  all.insert(all.end(), bytes.begin(), bytes.end());
  return all;
}

class VectorSemantics : public testing::Test {
 protected:
  static EnvConfig every_sensor() {
    EnvConfig config = quick_env_config();
    config.observation.waveform = config.observation.heard = config.observation.gps_compass = config.observation.pose = true;
    config.observation.collision = config.observation.previous_action = true;
    config.observation.interaural = config.observation.topdown_map = true;
    config.observation.oracle_action = config.observation.goal_state = true;
    config.observation.rgb = config.observation.semantic = config.observation.normals = config.observation.depth_noise = true;
    config.observation.cameras = {
        {.name = "around",
         .config = {.width_px = 16, .height_px = 8, .projection = Projection::equirectangular, .horizontal_fov_deg = 360},
         .depth = true,
         .rgb = true,
         .semantic = true,
         .normals = true}};
    return config;
  }
  BatchedEnv make(int envs, const EnvConfig& config) { return BatchedEnv(config, set_, scenes_, envs); }
  void step(BatchedEnv& env, int index) {
    std::vector<std::int32_t> actions;
    for (int i = 0; i < env.num_envs(); ++i) actions.push_back(test_action(i, index));
    env.step(actions);
  }
  EnvConfig config_ = every_sensor();
  std::shared_ptr<const EpisodeSet> set_ = quick_set(2);
  std::shared_ptr<SceneCache> scenes_ = make_scene_cache(config_);
};

}  // namespace earshot
