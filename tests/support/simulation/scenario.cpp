// SPDX-License-Identifier: Apache-2.0
#include <fmt/format.h>
#include <fmt/ranges.h>

#include <algorithm>

#include "tests/support/simulation/simulated_network.h"
#include "tests/support/simulation/simulated_run.h"
#include "trainer/collective/sum_order.h"

namespace earshot::simulation {

double Scenario::update_s() const {
  return 1.5 * (0.002 * minibatches + rollout_steps * 1.3 * step_ms / 1000) * *std::ranges::max_element(slowness) +
         100e-6 * static_cast<double>(most_latency_us);
}

Scenario scenario_of(std::uint64_t seed) {
  Random random(seed ^ 0x5eed);
  Scenario s;
  s.seed = seed;
  s.world_size = random.chance(0.2) ? 2 : static_cast<int>(random.between(3, 5));
  s.updates = static_cast<int>(random.between(3, 8));
  s.minibatches = static_cast<int>(random.between(1, 2));
  s.rollout_steps = static_cast<int>(random.between(2, 6));
  s.elements = random.chance(0.7) ? kSmallSumBytes / sizeof(float) + static_cast<std::size_t>(random.between(0, 999)) : 300;
  s.step_ms = static_cast<double>(random.between(1, 40));
  s.preempt_fraction = random.chance(0.5) ? 0.6 : 0;
  for (int rank = 0; rank < s.world_size; ++rank) s.slowness.push_back(random.chance(0.2) ? static_cast<int>(random.between(2, 6)) : 1);
  if (random.chance(0.2)) s.most_latency_us = 20000;
  const double whole_s = 0.02 + s.updates * s.rollout_steps * s.step_ms / 1000;
  const auto num_faults = random.between(0, 4);
  for (std::int64_t i = 0; i < num_faults; ++i) {
    Fault fault;
    fault.kind = static_cast<Fault::Kind>(random.between(0, 6));
    if (fault.kind != Fault::Kind::kill && random.chance(0.3)) fault.kind = Fault::Kind::kill;
    fault.rank = random.chance(0.3) ? 0 : static_cast<int>(random.between(0, s.world_size - 1));
    fault.other = (fault.rank + static_cast<int>(random.between(1, s.world_size - 1))) % s.world_size;
    fault.group = static_cast<std::uint64_t>(random.between(1, (1 << s.world_size) - 2));
    fault.at_s = random.chance(0.1) ? 0.001 * static_cast<double>(random.between(0, 20))
                                    : whole_s * static_cast<double>(random.between(0, 1000)) / 700;
    if (random.chance(0.2)) fault.at_s += static_cast<double>(random.between(0, 4000)) / 1000;
    fault.duration_s =
        random.chance(0.5) ? 0.001 * static_cast<double>(random.between(1, 500)) : 0.001 * static_cast<double>(random.between(500, 15000));
    if (fault.kind == Fault::Kind::kill && random.chance(0.5)) fault.after_messages = random.between(0, 200);
    const bool dies = fault.kind == Fault::Kind::kill || fault.kind == Fault::Kind::power_off;
    if (dies && random.chance(0.6)) fault.restart_s = 0.001 * static_cast<double>(random.between(0, random.chance(0.8) ? 200 : 3000));
    s.faults.push_back(fault);
  }
  return s;
}

std::string describe(const Scenario& s) {
  return fmt::format("# seed {}: {} workers (slowness {}), {} updates, {} elements, steps {} x {} ms, preempt {}, latency to {} us\n{}",
                     s.seed, s.world_size, s.slowness, s.updates, s.elements, s.rollout_steps, s.step_ms, s.preempt_fraction,
                     s.most_latency_us, encode_schedule(s.faults));
}

}  // namespace earshot::simulation
