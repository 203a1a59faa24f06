#include "sim/acoustics/paths/transmission.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <glm/geometric.hpp>
#include <numbers>
#include <tuple>

#include "sim/acoustics/model/effect_plan.h"

namespace earshot {
namespace {

constexpr float kParallel = 0.98f;     // cosine of 11 degrees
constexpr float kLeastCosine = 1e-3f;  // a grazing ray stays inside for at most 1000 thicknesses

/// Does the ray meet the front of this face, the side that the winding of its vertices points to?
bool meets_front(const AcousticScene& scene, glm::vec3 direction, std::uint32_t triangle) {
  const TriangleMesh& mesh = scene.scene().mesh();
  const glm::uvec3 t = mesh.triangles[triangle];
  const glm::dvec3 a = mesh.vertices[t.x], b = mesh.vertices[t.y], c = mesh.vertices[t.z];
  return glm::dot(glm::cross(b - a, c - a), glm::dvec3(direction)) < 0;
}

bool same_material(const AcousticScene& scene, std::uint32_t a, std::uint32_t b) {
  if (a == b) return true;
  const auto materials = std::span(scene.scene().materials());
  return materials[a].name == materials[b].name && std::ranges::equal(scene.transmission(a), scene.transmission(b)) &&
         std::ranges::equal(scene.damping_db_per_m(a), scene.damping_db_per_m(b)) &&
         materials[a].speed_m_per_s == materials[b].speed_m_per_s;
}

/// The far face of the wall whose near face is `hit`, if the next face along the ray can be one.
Hit find_far_face(const AcousticScene& scene, glm::vec3 start, glm::vec3 direction, const Hit& hit) {
  const float cosine = std::max(std::fabs(glm::dot(direction, hit.normal)), kLeastCosine);
  const Hit far = scene.scene().rays().intersect(start, direction, kMaxWallThicknessM / cosine);
  if (!far.valid()) return {};
  const bool enters = meets_front(scene, direction, hit.triangle), enters_again = meets_front(scene, direction, far.triangle);
  if (enters == enters_again) return {};
  // Corners and ends of walls: in at the front, out at the side.  Only outward windings tell that the way between is inside.
  const bool parallel = std::fabs(glm::dot(far.normal, hit.normal)) >= kParallel;
  if (!parallel && (!enters || far.distance_m > kMaxWallThicknessM)) return {};
  const auto& material = scene.scene().mesh().triangle_material;
  if (!same_material(scene, material[hit.triangle], material[far.triangle])) return {};
  return far;
}

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
  walls.extra_path_m += extra_path_m(scene, crossing);
  const auto tau = scene.transmission(crossing.material), damping = scene.damping_db_per_m(crossing.material);
  bool any = false;
  for (std::size_t band = 0; band < tau.size(); ++band) {
    walls.gain_db[band] += 10.0 * std::log10(double{tau[band]}) - double{damping[band]} * crossing.inside_m;  // tau = 0: minus infinity
    any = any || walls.gain_db[band] >= kSilentTransmissionDb;
  }
  return any;
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
    WallCrossing crossing = cross_wall(scene, direction, hit);
    const bool ends_inside = glm::dot(to - crossing.exit, direction) <= 0;
    if (ends_inside && crossing.thick) crossing.inside_m = glm::length(to - hit.position);
    if (!add_wall(scene, crossing, walls)) return false;
    if (ends_inside) return true;
    point = crossing.exit;
  }
}

glm::vec3 past(const Hit& hit) { return offset_from_surface(hit.position, -hit.normal); }

}  // namespace

WallCrossing cross_wall(const AcousticScene& scene, glm::vec3 direction, const Hit& hit) {
  WallCrossing crossing{.exit = past(hit), .material = scene.scene().mesh().triangle_material[hit.triangle]};
  const Hit far = find_far_face(scene, crossing.exit, direction, hit);
  if (!far.valid()) return crossing;
  const glm::vec3 exit = past(far);
  // Windings that point inward are either a wall turned inside out or the gap in front of a wall that begins here.
  if (!meets_front(scene, direction, hit.triangle) && find_far_face(scene, exit, direction, far).valid()) return crossing;
  crossing.exit = exit;
  crossing.inside_m = glm::length(far.position - hit.position);
  crossing.thick = true;
  return crossing;
}

void transmit(const AcousticScene& scene, const WallCrossing& crossing, std::span<float> share) {
  const auto tau = scene.transmission(crossing.material);
  for (std::size_t band = 0; band < tau.size(); ++band) share[band] *= tau[band];
  if (!(crossing.inside_m > 0)) return;
  const auto damping = scene.damping_db_per_m(crossing.material);
  for (std::size_t band = 0; band < damping.size(); ++band) {
    if (damping[band] > 0) share[band] *= std::pow(10.f, -0.1f * damping[band] * crossing.inside_m);
  }
}

float extra_path_m(const AcousticScene& scene, const WallCrossing& crossing) {
  const float speed = scene.scene().materials()[crossing.material].speed_m_per_s;
  return speed > 0 ? crossing.inside_m * (scene.speed_of_sound_m_per_s() / speed - 1.f) : 0.f;
}

void find_transmitted(const AcousticScene& scene, glm::vec3 source, glm::vec3 listener, std::vector<Arrival>& arrivals) {
  if (!scene.plan().straight_transmission || source == listener) return;
  if (scene.scene().rays().occluded(source, listener)) find_transmitted_behind_walls(scene, source, listener, arrivals);
}

void find_transmitted_behind_walls(const AcousticScene& scene, glm::vec3 source, glm::vec3 listener, std::vector<Arrival>& arrivals) {
  const glm::dvec3 toward = glm::dvec3(source) - glm::dvec3(listener);
  const double true_distance_m = glm::length(toward), distance_m = std::max(true_distance_m, double{kLeastDistanceM});

  // Rounding depends on where a ray starts: always walk from the same end (reciprocity).
  const bool swapped = std::tie(listener.x, listener.y, listener.z) < std::tie(source.x, source.y, source.z);
  Walls walls;
  if (!collect_walls(scene, swapped ? listener : source, swapped ? source : listener, walls) || walls.count == 0) return;
  const double delay_path_m = std::max(distance_m + walls.extra_path_m, double{kLeastDistanceM});
  if (delay_path_m > scene.max_path_m()) return;

  Arrival arrival{.kind = ArrivalKind::transmission, .order = walls.count, .distance_m = static_cast<float>(delay_path_m)};
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
