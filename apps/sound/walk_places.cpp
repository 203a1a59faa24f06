#include "apps/sound/walk_places.h"

#include <fmt/format.h>

#include <iterator>
#include <optional>

#include "sim/acoustics/response/place_check.h"

namespace earshot {
namespace {

/// A source and the listener at one time.
struct WalkPair {
  glm::vec3 source{0}, listener{0};
};

/// In line of sight, or moved through air from the pair before: nothing new to check.
bool is_as_before(const EmbreeScene& rays, const std::optional<WalkPair>& before, const WalkPair& pair) {
  if (!rays.occluded(pair.source, pair.listener)) return true;
  return before && !rays.occluded(before->source, pair.source) && !rays.occluded(before->listener, pair.listener);
}

bool is_inside(const Bounds& bounds, glm::vec3 place) {
  for (int axis = 0; axis < 3; ++axis)
    if (place[axis] < bounds.lower[axis] || place[axis] > bounds.upper[axis]) return false;
  return true;
}

}  // namespace

std::vector<std::string> check_walk_places(const AcousticScene& acoustics, const std::vector<TimedPose>& listener,
                                           const std::vector<std::vector<TimedPose>>& sources, const std::vector<double>& times_s) {
  const PlaceCheck check(acoustics);
  const Scene& scene = acoustics.scene();
  std::vector<std::string> warnings;
  for (const std::vector<TimedPose>& path : sources) {
    std::optional<WalkPair> before;
    std::vector<std::string> of_source;
    for (const double t_s : times_s) {
      const WalkPair pair{glm::vec3(pose_at(path, t_s).position), glm::vec3(pose_at(listener, t_s).position)};
      const bool is_anything_inside = is_inside(scene.bounds(), pair.source) || is_inside(scene.bounds(), pair.listener);
      if (!is_anything_inside || !is_as_before(scene.rays(), before, pair)) {
        const std::string source = fmt::format("source at {:.6g} s,", t_s), heard = fmt::format("listener at {:.6g} s,", t_s);
        std::vector<std::string> odd = check.check({source, pair.source}, {heard, pair.listener});
        if (of_source.empty()) of_source = std::move(odd);
      }
      before = pair;
    }
    std::ranges::move(of_source, std::back_inserter(warnings));
  }
  return warnings;
}

}  // namespace earshot
