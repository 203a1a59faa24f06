// SPDX-License-Identifier: Apache-2.0
#include "envs/task/goal_silence.h"

#include <algorithm>
#include <limits>

namespace earshot {

double goal_silent_from_s(const Episode& episode, const std::function<double(const std::string& sound)>& clip_length_s) {
  constexpr double kEndless = std::numeric_limits<double>::infinity();
  const bool names_a_goal = std::any_of(episode.sources.begin(), episode.sources.end(), [](const auto& source) { return source.goal; });
  double silent_from_s = names_a_goal ? 0 : kEndless;
  for (const EpisodeSource& source : episode.sources) {
    if (!source.goal) continue;
    double length_s = source.duration_s < 0 ? kEndless : source.duration_s;
    if (!source.loop && clip_length_s) length_s = std::min(length_s, clip_length_s(source.sound));
    silent_from_s = std::max(silent_from_s, source.onset_s + length_s);
  }
  return silent_from_s;
}

}  // namespace earshot
