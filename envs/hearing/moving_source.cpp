// SPDX-License-Identifier: Apache-2.0
#include "envs/hearing/moving_source.h"

#include <algorithm>
#include <iterator>

#include "envs/hearing/same_bits.h"

namespace earshot {

glm::vec3 MovingSource::place_at(double sample) const {
  const auto next = std::find_if(path_.begin(), path_.end(), [&](const TimedPlace& place) { return place.sample > sample; });
  if (next == path_.begin()) return path_.front().position;
  if (next == path_.end()) return path_.back().position;
  const TimedPlace& last = *std::prev(next);
  const auto part = static_cast<float>((sample - last.sample) / (next->sample - last.sample));
  return last.position + part * (next->position - last.position);
}

void MovingSource::move_to(glm::vec3 place) {
  if (candidates_ && same_bits(candidates_->source(), place)) return;
  candidates_ = std::make_unique<const EarlyCandidates>(scene_->acoustics, place, SourceMotion::moves);
}

}  // namespace earshot
