// SPDX-License-Identifier: Apache-2.0
#include "apps/sound/walk_places.h"

#include <fmt/format.h>

#include <algorithm>
#include <iterator>

#include "sim/acoustics/response/place_check.h"

namespace earshot {

std::vector<std::string> check_walk_places(const AcousticScene& acoustics, const std::vector<TimedPose>& listener,
                                           const std::vector<std::vector<TimedPose>>& sources, const std::vector<double>& times_s) {
  const PlaceCheck check(acoustics);
  std::vector<std::string> warnings;
  for (const std::vector<TimedPose>& path : sources) {
    std::vector<std::string> of_source;
    for (const double t_s : times_s) {
      const std::string source = fmt::format("source at {:.6g} s,", t_s), heard = fmt::format("listener at {:.6g} s,", t_s);
      std::vector<std::string> odd =
          check.check({source, glm::vec3(pose_at(path, t_s).position)}, {heard, glm::vec3(pose_at(listener, t_s).position)});
      if (of_source.empty()) of_source = std::move(odd);
    }
    std::ranges::move(of_source, std::back_inserter(warnings));
  }
  return warnings;
}

}  // namespace earshot
