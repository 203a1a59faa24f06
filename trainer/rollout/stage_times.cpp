// SPDX-License-Identifier: Apache-2.0
#include "trainer/rollout/stage_times.h"

#include <fmt/format.h>

#include <array>
#include <utility>

namespace earshot {

StageTimes StageTimes::of(const StageSeconds& env) {
  StageTimes times;
  times.simulate_sound = env.trace + env.synthesize;
  times.convolve = env.convolve + env.observe;
  times.render = env.render;
  times.move = env.move + env.reset;
  return times;
}

void StageTimes::add(const StageTimes& other, double factor) {
  simulate_sound += factor * other.simulate_sound;
  convolve += factor * other.convolve;
  render += factor * other.render;
  move += factor * other.move;
  policy += factor * other.policy;
  learn += factor * other.learn;
  reduce += factor * other.reduce;
}

double StageTimes::total() const { return simulate_sound + convolve + render + move + policy + learn + reduce; }

std::string StageTimes::fractions() const {
  const std::array<std::pair<const char*, double>, 7> parts{{{"sound", simulate_sound},
                                                             {"convolve", convolve},
                                                             {"render", render},
                                                             {"move", move},
                                                             {"policy", policy},
                                                             {"learn", learn},
                                                             {"reduce", reduce}}};
  const double all = total();
  std::string text;
  for (const auto& [name, seconds] : parts)
    text += fmt::format("{}{} {:.0f} %", text.empty() ? "" : "  ", name, all > 0 ? 100 * seconds / all : 0.0);
  return text;
}

}  // namespace earshot
