// SPDX-License-Identifier: Apache-2.0
#include <fmt/format.h>

#include <algorithm>
#include <cmath>

#include "bench/measure/statistics.h"
#include "bench/soak/soak.h"

namespace earshot {
namespace {

/// The heap finds its high-water mark when the largest scene is loaded: before every scene has been there, and in fewer than 100,000 steps,
/// growth below this says nothing.
constexpr double kNoiseMiB = 32;

SoakBound none_of(const std::string& name, std::uint64_t count, const std::string& unit) {
  return {name, fmt::format("{} {}", count, unit), "0", count == 0 ? BoundStatus::held : BoundStatus::broken};
}

SoakBound memory_bound(const SoakResult& result) {
  const double slope = kSlopeSteps * result.resident_slope.per_x, error = kSlopeSteps * result.resident_slope.standard_error;
  const auto window = static_cast<double>(result.steps - std::min(result.steps, result.warm_up_steps));
  const bool warm = result.all_scenes_before && window >= kSlopeSteps;
  const double noise = !warm && window > 0 ? kNoiseMiB * kSlopeSteps / window : 0;
  const double limit = std::max(result.options.memory_limit_mib, noise);
  SoakBound bound{.name = "resident memory",
                  .found = fmt::format("{:+.3f} ± {:.3f} MiB per 100,000 steps after the first {}", slope, error, result.warm_up_steps),
                  .bound = fmt::format("{:.3g} MiB per 100,000 steps, two standard errors clear", limit)};
  if (result.resident_slope.points < 10)
    bound.status = BoundStatus::open;
  else if (slope - 2 * error > limit)
    bound.status = BoundStatus::broken;
  else if (slope + 2 * error > limit)
    bound.status = BoundStatus::open;
  return bound;
}

}  // namespace

std::vector<SoakBound> SoakResult::bounds() const {
  std::vector<SoakBound> list;
  const bool all_steps = steps >= options.steps;
  list.push_back({"steps", failure.empty() ? fmt::format("{} in {:.1f} min", steps, seconds / 60) : failure,
                  fmt::format("{}", options.steps),
                  !failure.empty() ? BoundStatus::broken
                  : all_steps      ? BoundStatus::held
                                   : BoundStatus::open});
  const auto fault = [&](SoakFault which) { return faults[static_cast<std::size_t>(which)]; };
  list.push_back(none_of("finite observations and rewards", fault(SoakFault::not_finite) + nonfinite_events, "not finite"));
  list.push_back(none_of("observations and rewards in their ranges", fault(SoakFault::out_of_range), "outside"));
  list.push_back(none_of("agents inside their scene", fault(SoakFault::out_of_the_scene), "outside"));
  list.push_back({"heard energy",
                  fmt::format("largest {:+.1f} dB re free field and diffuse field, {} over the bound",
                              10 * std::log10(std::max(loudness.max(), 1e-30)), fault(SoakFault::too_loud)),
                  fmt::format("{:+.1f} dB", 10 * std::log10(kLoudnessMargin)),
                  fault(SoakFault::too_loud) == 0 ? BoundStatus::held : BoundStatus::broken});
  list.push_back(memory_bound(*this));
  list.push_back({"scene cache", fmt::format("at most {:.1f} MiB, {} scenes dropped", largest_cache, evicted_scenes),
                  fmt::format("{:.1f} MiB", cache_bound), largest_cache <= cache_bound ? BoundStatus::held : BoundStatus::broken});
  list.push_back(none_of("quarantined episodes", quarantined.total(), "episodes"));
  list.push_back({"cold replays", fmt::format("{} of {} differ", replays_that_differ, replayed), "0, bit for bit",
                  replays_that_differ > 0 ? BoundStatus::broken
                  : replayed > 0          ? BoundStatus::held
                                          : BoundStatus::open});
  return list;
}

bool SoakResult::passed() const {
  for (const SoakBound& bound : bounds())
    if (bound.status == BoundStatus::broken) return false;
  return true;
}

}  // namespace earshot
