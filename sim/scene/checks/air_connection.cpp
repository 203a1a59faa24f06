// SPDX-License-Identifier: Apache-2.0
#include "sim/scene/checks/air_connection.h"

#include <array>
#include <cstddef>
#include <cstdint>
#include <glm/geometric.hpp>
#include <vector>

#include "sim/scene/probe_rays.h"

namespace earshot {
namespace {

constexpr std::uint32_t kFirstWalks = 256, kAllWalks = 16384, kReflections = 32;
constexpr std::size_t kMaxPoints = 2048;

/// Walks from one of the places.
class Wanderer {
 public:
  Wanderer(const Scene& scene, glm::vec3 start, std::uint32_t number) : scene_(scene), start_(start), number_(number), reached_{start} {}

  /// Walks once more.  True if a point of the walk is in line of sight of a point that the other has reached.  Points lie in the air
  /// between two reflections: one on a surface, seen from far away, may round to its other side.
  bool meets(const Wanderer& other) {
    const RandomStream random = probe::stream(number_, probe::Use::connection, walks_++);
    glm::vec3 from = start_, direction = probe::uniform_direction(random.uniform2(0));
    for (std::uint32_t reflection = 1; reflection <= kReflections; ++reflection) {
      const Hit hit = scene_.rays().intersect(from, direction);
      if (!hit.valid()) {
        ++escaped_;
        return false;
      }
      const std::array<float, 4> u = random.uniform4(2 * reflection);
      const glm::vec3 between = from + direction * (hit.distance_m * (0.1f + 0.8f * u[0]));
      const auto goal = static_cast<std::size_t>(u[1] * static_cast<float>(other.reached_.size()));
      if (!scene_.rays().occluded(between, other.reached_[goal])) return true;
      keep(between);
      from = offset_from_surface(hit.position, hit.normal);
      direction = probe::cosine_direction(hit.normal, random.uniform2(2 * reflection + 1));
    }
    return false;
  }
  [[nodiscard]] std::uint32_t walks() const { return walks_; }
  [[nodiscard]] std::uint32_t escaped() const { return escaped_; }

 private:
  void keep(glm::vec3 point) {
    if (reached_.size() < kMaxPoints)
      reached_.push_back(point);
    else
      reached_[next_++ % kMaxPoints] = point;
  }

  const Scene& scene_;
  glm::vec3 start_;
  std::uint32_t number_;
  std::vector<glm::vec3> reached_;
  std::size_t next_ = 0;
  std::uint32_t walks_ = 0, escaped_ = 0;
};

/// A place far away, moved through the free air around the scene until floats tell the two sides of a wall apart from there.
glm::vec3 brought_near(const Scene& scene, glm::vec3 place) {
  const glm::vec3 centre = 0.5f * (scene.bounds().lower + scene.bounds().upper);
  const float most_m = glm::length(scene.bounds().upper - scene.bounds().lower), distance_m = glm::length(place - centre);
  return distance_m > most_m ? centre + (place - centre) * (most_m / distance_m) : place;
}

}  // namespace

AirBetween air_between(const Scene& scene, glm::vec3 first, glm::vec3 second) {
  if (scene.mesh().triangles.empty()) return AirBetween::joined;
  first = brought_near(scene, first);
  second = brought_near(scene, second);
  if (!scene.rays().occluded(first, second)) return AirBetween::joined;
  Wanderer first_walker(scene, first, 0), second_walker(scene, second, 1);
  while (first_walker.walks() < kFirstWalks)
    if (first_walker.meets(second_walker) || second_walker.meets(first_walker) ||
        (first_walker.escaped() > 0 && second_walker.escaped() > 0))
      return AirBetween::joined;
  const bool first_open = 2 * first_walker.escaped() > kFirstWalks, second_open = 2 * second_walker.escaped() > kFirstWalks;
  if (!first_open && !second_open) return AirBetween::apart;
  Wanderer& enclosed = first_open ? second_walker : first_walker;
  const Wanderer& outside = first_open ? first_walker : second_walker;
  while (enclosed.walks() < kAllWalks)
    if (enclosed.meets(outside) || enclosed.escaped() > 0) return AirBetween::joined;
  return first_open ? AirBetween::first_outside : AirBetween::second_outside;
}

}  // namespace earshot
