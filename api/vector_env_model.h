// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <vector>

#include "earshot/env.h"
#include "envs/batch/batched_env.h"

namespace earshot::api {

struct VectorEnv::Model {
  BatchedEnv env;
  std::vector<SensorInfo> sensors;
};

}  // namespace earshot::api
