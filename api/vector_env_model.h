// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <ctime>
#include <memory>
#include <vector>

#include "earshot/env.h"
#include "envs/batch/batched_env.h"
#include "envs/episodes/episode_set.h"

namespace earshot::api {

struct VectorEnv::Model {
  BatchedEnv env;
  std::vector<SensorInfo> sensors;
  std::shared_ptr<const earshot::EpisodeSet> set;
  timespec made_after;  ///< of the clock that stamps files
};

}  // namespace earshot::api
