// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <optional>
#include <string>
#include <vector>

#include "trainer/checkpoint/checkpoint.h"

namespace earshot {

/// Which part of the environments each rank of a start has (Checkpoint::members).
struct EnvPlaces {
  std::vector<int> members;
  int started_workers = 0;
  bool begin_anew = false;  ///< the checkpoint's are of another number of workers
  [[nodiscard]] int first_of(int rank) const { return members[static_cast<std::size_t>(rank)]; }
};

/// Of a run that is started, or that goes on from a checkpoint.  changes: keys that the user allows to differ (RunStart::changes).
/// Throws InputError if the checkpoint is of another number of workers and "workers" is not among them.
EnvPlaces env_places_of(const std::optional<Checkpoint>& resumed, int world_size, const std::vector<std::string>& changes);

}  // namespace earshot
