// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <memory>

#include "earshot/episodes.h"
#include "envs/episodes/episode_set.h"

namespace earshot::api {

struct EpisodeSet::Model {
  std::shared_ptr<const earshot::EpisodeSet> set;
};

}  // namespace earshot::api
