// SPDX-License-Identifier: Apache-2.0
#include "envs/baselines/bearing_memory.h"

#include <algorithm>
#include <cmath>
#include <numbers>

#include "sim/audio/head/interaural_bearing.h"
#include "sim/base/errors.h"

namespace earshot {
namespace {

constexpr double kDecayOfSound = 0.95, kDecayOfStep = 0.93;
constexpr double kTurn = 2.0 * std::numbers::pi;

}  // namespace

void BearingMemory::add(double heading_rad, std::span<const float> response) {
  EARSHOT_EXPECT(response.size() == InterauralBearing::kNumAngles);
  ++heard_;
  for (int bin = 0; bin < kNumBins; ++bin) {
    // The lateral angle of a bearing: that of its mirror image in front.
    const double lateral_rad = std::asin(std::clamp(std::sin(bin * kTurn / kNumBins - heading_rad), -1.0, 1.0));
    const double place = (lateral_rad / std::numbers::pi + 0.5) * (InterauralBearing::kNumAngles - 1);
    const auto low = std::min(static_cast<std::size_t>(std::max(0.0, place)), static_cast<std::size_t>(InterauralBearing::kNumAngles - 2));
    const double t = place - static_cast<double>(low);
    const double value = (1 - t) * static_cast<double>(response[low]) + t * static_cast<double>(response[low + 1]);
    double& evidence = evidence_[static_cast<std::size_t>(bin)];
    evidence = kDecayOfSound * evidence + value;
  }
}

void BearingMemory::age() {
  for (double& evidence : evidence_) evidence *= kDecayOfStep;
}

std::optional<double> BearingMemory::bearing_rad() const {
  if (heard_ == 0) return std::nullopt;
  const auto best = std::ranges::max_element(evidence_) - evidence_.begin();
  return std::remainder(static_cast<double>(best) * kTurn / kNumBins, kTurn);
}

}  // namespace earshot
