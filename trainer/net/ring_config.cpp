#include "trainer/net/ring_config.h"

#include <fmt/format.h>

namespace earshot {

void validate_world(int num_workers, OnLoss on_loss) {
  require(num_workers >= 1 && num_workers <= kMaxWorkers, "workers", num_workers, fmt::format("must be in [1, {}]", kMaxWorkers));
  require(num_workers <= kMaxMeshWorkers || on_loss == OnLoss::stop, "network.on_loss", "continue",
          fmt::format("must be stop with {} workers: more than {} do not go on without one of them", num_workers, kMaxMeshWorkers));
}

}  // namespace earshot
