// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <string>
#include <vector>

#include "tests/support/envs/env_fixture.h"

/// Episodes for tests of the quarantine.
namespace earshot::quarantine_cases {

inline const std::string kRoom = "shoebox:6x3x5@0.3";

/// `count` starts in one room with one goal.
inline std::vector<Episode> room_episodes(int count) {
  std::vector<Episode> all;
  for (int i = 0; i < count; ++i) {
    all.push_back(room_episode(kRoom, {1 + 0.1 * i, 0, 1}, 0.3 * i, {4, 0, 3}, "synth:noise"));
    all.back().episode_id = std::to_string(i);
  }
  return all;
}

}  // namespace earshot::quarantine_cases
