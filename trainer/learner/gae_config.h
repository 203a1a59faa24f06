// SPDX-License-Identifier: Apache-2.0
#pragma once

namespace earshot {

/// Discounts per step of generalized advantage estimation, both in [0, 1].
struct GaeConfig {
  double gamma = 0.99, lambda = 0.95;
};

}  // namespace earshot
