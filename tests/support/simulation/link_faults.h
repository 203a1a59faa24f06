// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "tests/support/simulation/fault_schedule.h"
#include "tests/support/simulation/simulated_network.h"

namespace earshot::simulation {

inline constexpr Nanos kResend = 200 * kMilli;  ///< the shortest time after which TCP sends a lost packet again

/// A fault of links, not of processes.
inline void inflict_on_links(Network& network, const Fault& fault, int world_size) {
  const auto lasts = static_cast<Nanos>(fault.duration_s * 1e9);
  switch (fault.kind) {
    case Fault::Kind::reset:
      return network.reset(fault.rank, fault.other);
    case Fault::Kind::cut:
      for (int a = 0; a < world_size; ++a)
        for (int b = 0; b < world_size; ++b)
          if ((fault.group >> a & 1) != (fault.group >> b & 1)) network.cut(a, b, lasts);
      return;
    case Fault::Kind::cut_way:
      return network.cut(fault.rank, fault.other, lasts);
    case Fault::Kind::delay:
      return network.hold_up(fault.rank, static_cast<Nanos>(fault.amount * 1e9), 1, lasts);
    case Fault::Kind::lose:
      return network.hold_up(fault.rank, kResend, fault.amount, lasts);
    default:
      return;
  }
}

}  // namespace earshot::simulation
