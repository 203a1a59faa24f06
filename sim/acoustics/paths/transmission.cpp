// SPDX-License-Identifier: Apache-2.0
#include "sim/acoustics/paths/transmission.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <glm/geometric.hpp>
#include <numbers>
#include <tuple>

#include "sim/acoustics/model/wall_crossing.h"
#include "sim/acoustics/paths/line_of_sight.h"

namespace earshot {
namespace {

/// The walls of one straight line, added up.
struct Walls {
  int count = 0;
  double inside_m = 0, extra_path_m = 0;
  std::array<double, kMaxBands> gain_db{};
};

/// Adds one wall.  False if no band is left.
bool add_wall(const AcousticScene& scene, const WallCrossing& crossing, Walls& walls) {
  ++walls.count;
  walls.inside_m += crossing.inside_m;
  walls.extra_path_m += extra_path_m(scene.surfaces(), crossing);
  const auto tau = scene.transmission(crossing.material), damping = scene.damping_db_per_m(crossing.material);
  bool is_audible = false;
  for (std::size_t band = 0; band < tau.size(); ++band) {
    walls.gain_db[band] += 10.0 * std::log10(double{tau[band]}) - double{damping[band]} * crossing.inside_m;  // tau = 0: minus infinity
    is_audible = is_audible || walls.gain_db[band] >= kSilentTransmissionDb;
  }
  return is_audible;
}

/// All walls between two points.  False if no sound passes.
bool collect_walls(const AcousticScene& scene, glm::vec3 from, glm::vec3 to, Walls& walls) {
  glm::vec3 point = from;
  for (;;) {
    const glm::vec3 rest = to - point;  // aimed anew from each wall, so that rounding does not add up
    const float rest_m = glm::length(rest);
    if (!(rest_m > 0)) return true;
    const glm::vec3 direction = rest / rest_m;
    const Hit hit = scene.scene().rays().intersect(point, direction, open_length_m(to, rest_m));
    if (!hit.valid()) return true;
    if (walls.count == scene.config().transmission_walls) return false;
    WallCrossing crossing = cross_wall(scene.surfaces(), direction, hit, rest_m - hit.distance_m);
    const bool ends_inside = glm::dot(to - crossing.exit, direction) <= 0;
    if (ends_inside && crossing.thick) crossing.inside_m = glm::length(to - hit.position);
    if (!add_wall(scene, crossing, walls)) return false;
    if (ends_inside) return true;
    point = crossing.exit;
  }
}

}  // namespace

void find_transmitted(const AcousticScene& scene, glm::vec3 source, glm::vec3 listener, std::vector<Arrival>& arrivals) {
  if (!scene.plan().straight_transmission) return;
  if (!in_line_of_sight(scene, source, listener)) find_transmitted_behind_walls(scene, source, listener, arrivals);
}

void find_transmitted_behind_walls(const AcousticScene& scene, glm::vec3 source, glm::vec3 listener, std::vector<Arrival>& arrivals) {
  const glm::dvec3 toward = glm::dvec3(source) - glm::dvec3(listener);
  const double true_distance_m = glm::length(toward), distance_m = std::max(true_distance_m, double{kMinDistanceM});

  // Rounding depends on where a ray starts: always walk from the same end (reciprocity).
  const bool swapped = std::tie(listener.x, listener.y, listener.z) < std::tie(source.x, source.y, source.z);
  Walls walls;
  if (!collect_walls(scene, swapped ? listener : source, swapped ? source : listener, walls) || walls.count == 0) return;
  const double delay_path_m = std::max(distance_m + walls.extra_path_m, double{kMinDistanceM});
  if (delay_path_m > scene.max_path_m()) return;

  Arrival arrival{.kind = ArrivalKind::transmission,
                  .identity = path_identity(ArrivalKind::transmission, {}),
                  .order = walls.count,
                  .distance_m = static_cast<float>(delay_path_m)};
  arrival.direction = glm::vec3(toward / true_distance_m);
  arrival.departure = -arrival.direction;
  const double air_m = std::max(distance_m - walls.inside_m, 0.0);
  for (int band = 0; band < scene.num_bands(); ++band) {
    const double gain_db = walls.gain_db[band];
    if (gain_db < kSilentTransmissionDb) continue;
    const double air = std::exp(-0.5 * scene.air_energy_per_m()[band] * air_m);
    arrival.amplitude[band] = static_cast<float>(std::pow(10.0, gain_db / 20.0) * air / (4.0 * std::numbers::pi * distance_m));
  }
  const auto place = std::find_if(arrivals.begin(), arrivals.end(), [&](const Arrival& a) { return a.distance_m > arrival.distance_m; });
  arrivals.insert(place, arrival);
}

}  // namespace earshot
