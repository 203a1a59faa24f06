// SPDX-License-Identifier: Apache-2.0
#include "sim/acoustics/response/sphere_arrivals.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <complex>
#include <glm/geometric.hpp>
#include <numbers>
#include <span>

#include "sim/acoustics/paths/line_of_sight.h"
#include "sim/acoustics/paths/panel_reflection.h"
#include "sim/acoustics/paths/transmission.h"
#include "sim/base/random.h"

namespace earshot {
namespace {

constexpr std::size_t kLeastToThin = 32;  // points from which on a quarter does in the shadow
/// Of each four pairs in turn, the one that is used in the shadow: of all radii and turns alike.
constexpr std::array<std::size_t, 4> kUsedOfFour = {2, 0, 3, 1};
constexpr double kTurn = 2 * std::numbers::pi;

/// One part of the sphere.
struct SpherePoint {
  glm::vec3 at{0};
  bool in_sight = false;
};

/// Points of the disc that the sphere is from the listener, with their lines of sight.
std::vector<SpherePoint> points_of_sphere(const AcousticScene& scene, const SoundSource& source, glm::vec3 listener) {
  const glm::dvec3 toward = glm::dvec3(source.position) - glm::dvec3(listener);
  const double distance_m = glm::length(toward);
  const glm::dvec3 axis = toward / distance_m;
  // Frame of Duff et al., JCGT 2017.
  const double sign = std::copysign(1.0, axis.z), a = -1.0 / (sign + axis.z), b = axis.x * axis.y * a;
  const glm::dvec3 x(1.0 + sign * axis.x * axis.x * a, sign * b, -sign * axis.x), y(b, sign + axis.y * axis.y * a, -axis.y);
  const double turn = double{RandomStream(scene.config().seed, Purpose::source_sphere).uniform(0)};
  std::vector<SpherePoint> points(static_cast<std::size_t>(scene.config().direct_rays));
  const std::size_t pairs = points.size() / 2;
  for (std::size_t i = 0; i < points.size(); ++i) {
    // An odd one is the centre.  Half a turn for all first points of pairs, by the golden ratio (Vogel 1979); the second ones are opposite.
    glm::dvec3 offset(0);
    if (i < 2 * pairs) {
      const double radius_m = source.radius_m * std::sqrt((static_cast<double>(i / 2) + 0.5) / static_cast<double>(pairs));
      const double angle = 0.5 * kTurn * (std::fmod(static_cast<double>(i / 2) * 0.6180339887498949, 1.0) + turn);
      offset = (i % 2 == 0 ? radius_m : -radius_m) * (std::cos(angle) * x + std::sin(angle) * y);
    }
    const glm::dvec3 ray = toward + offset;
    points[i].at = glm::vec3(glm::dvec3(listener) + ray * (distance_m / glm::length(ray)));
    points[i].in_sight = in_line_of_sight(scene, points[i].at, listener);
  }
  return points;
}

double energy_of(const Arrival& arrival, std::size_t num_bands) {
  double sum = 0;
  for (std::size_t band = 0; band < num_bands; ++band) sum += double{arrival.amplitude[band]} * double{arrival.amplitude[band]};
  return sum;
}

/// One path with what all points bring along it.
class SpherePath {
 public:
  explicit SpherePath(const Arrival& first) : arrival_(first) {}
  [[nodiscard]] std::uint64_t identity() const { return arrival_.identity; }

  /// Adds the arrival of one point.
  void add(const Arrival& arrival, std::size_t num_bands) {
    const double energy = energy_of(arrival, num_bands);
    distance_m_ += energy * double{arrival.distance_m};
    timed_energy_ += energy;
    // The straight line is one path whether a wall is in its way or not.
    if (arrival.kind == ArrivalKind::direct) arrival_.kind = arrival.kind, arrival_.order = arrival.order;
    add_directions(arrival, energy);
    for (std::size_t band = 0; band < num_bands; ++band)
      add_band(band, double{arrival.amplitude[band]} * double{arrival.amplitude[band]}, double{arrival.phase_rad[band]});
  }
  /// Adds what belongs to this path but takes another time.
  void add_directions(const Arrival& arrival, double energy) {
    direction_ += energy * glm::dvec3(arrival.direction);
    departure_ += energy * glm::dvec3(arrival.departure);
  }
  void add_band(std::size_t band, double energy, double phase_rad) {
    energy_[band] += energy;
    phasor_[band] += std::polar(energy, phase_rad);
  }

  /// The arrival of `count` points.  False if it has no energy.
  [[nodiscard]] bool finish(std::size_t count, std::size_t num_bands, Arrival& arrival) const {
    arrival = arrival_;
    bool is_audible = false;
    for (std::size_t band = 0; band < num_bands; ++band) {
      arrival.amplitude[band] = static_cast<float>(std::sqrt(energy_[band] / static_cast<double>(count)));
      arrival.phase_rad[band] = phasor_[band] == 0.0 ? 0.f : static_cast<float>(std::arg(phasor_[band]));
      is_audible = is_audible || arrival.amplitude[band] > 0.f;
    }
    if (timed_energy_ > 0) arrival.distance_m = static_cast<float>(distance_m_ / timed_energy_);
    if (const double length = glm::length(direction_); length > 0) arrival.direction = glm::vec3(direction_ / length);
    if (const double length = glm::length(departure_); length > 0) arrival.departure = glm::vec3(departure_ / length);
    return is_audible;
  }

 private:
  Arrival arrival_;  ///< of the first point: what all have in common
  double distance_m_ = 0, timed_energy_ = 0;
  glm::dvec3 direction_{0}, departure_{0};
  std::array<double, kMaxBands> energy_{};
  std::array<std::complex<double>, kMaxBands> phasor_{};
};

/// The paths of all points, in the order in which they were found.
class SpherePaths {
 public:
  explicit SpherePaths(const AcousticScene& scene) : scene_(scene), num_bands_(static_cast<std::size_t>(scene.num_bands())) {}

  void add(const Arrival& arrival) { path_of(arrival).add(arrival, num_bands_); }

  /// Adds a hidden point's arrivals beside `direct`, the direct sound of another point: what comes with at most half a wave of detour
  /// belongs to that, with the energy of its sum as pressures.
  void add_hidden(std::span<const Arrival> arrivals, const Arrival& direct) {
    std::array<std::complex<double>, kMaxBands> sum{};
    SpherePath& straight = path_of(direct);
    for (const Arrival& arrival : arrivals) {
      if (arrival.kind != ArrivalKind::diffraction) continue;
      double energy = 0;
      for (std::size_t band = 0; band < num_bands_; ++band) {
        const double detour_waves = waves(arrival, direct, band), weight = boundary_weight(detour_waves);
        sum[band] +=
            std::polar(std::sqrt(weight) * double{arrival.amplitude[band]}, double{arrival.phase_rad[band]} - kTurn * detour_waves);
        energy += weight * double{arrival.amplitude[band]} * double{arrival.amplitude[band]};
      }
      straight.add_directions(arrival, energy);
    }
    for (std::size_t band = 0; band < num_bands_; ++band) straight.add_band(band, std::norm(sum[band]), std::arg(sum[band]));
    for (Arrival rest : arrivals) {
      for (std::size_t band = 0; rest.kind == ArrivalKind::diffraction && band < num_bands_; ++band)
        rest.amplitude[band] *= static_cast<float>(std::sqrt(std::max(1.0 - boundary_weight(waves(rest, direct, band)), 0.0)));
      add(rest);
    }
  }

  /// The paths of `count` points that have energy, in the place of `arrivals`.
  void finish(std::size_t count, std::vector<Arrival>& arrivals) const {
    arrivals.clear();
    Arrival arrival;
    for (const SpherePath& path : paths_)
      if (path.finish(count, num_bands_, arrival)) arrivals.push_back(arrival);
    std::ranges::stable_sort(arrivals, {}, &Arrival::distance_m);
  }

 private:
  SpherePath& path_of(const Arrival& arrival) {
    const auto known = std::ranges::find(paths_, arrival.identity, &SpherePath::identity);
    return known != paths_.end() ? *known : paths_.emplace_back(arrival);
  }
  /// Detour over the direct sound in wavelengths at the centre of a band.
  [[nodiscard]] double waves(const Arrival& arrival, const Arrival& direct, std::size_t band) const {
    const double detour_m = double{arrival.distance_m} - double{direct.distance_m};
    return std::max(detour_m, 0.0) * scene_.bands().centre_hz[band] / scene_.speed_of_sound_m_per_s();
  }

  const AcousticScene& scene_;
  std::size_t num_bands_;
  std::vector<SpherePath> paths_;
};

}  // namespace

bool is_sphere(const AcousticScene& scene, const SoundSource& source, glm::vec3 listener) {
  if (scene.config().direct == Switch::off && !scene.plan().diffraction && !scene.plan().straight_transmission) return false;
  return source.radius_m > 0.f && scene.config().direct_rays > 1 && glm::distance(source.position, listener) > kMinDistanceM;
}

PoseEffects find_sphere_arrivals(const AcousticScene& scene, const EarlyCandidates& candidates, glm::vec3 listener,
                                 std::vector<Arrival>& arrivals) {
  const std::vector<SpherePoint> points = points_of_sphere(scene, candidates.sound_source(), listener);
  const auto first_in_sight = std::ranges::find(points, true, &SpherePoint::in_sight);
  Arrival direct;  // of any point: all are as far away as the centre
  PoseEffects effects{.in_sight = first_in_sight != points.end(), .transmission = false, .diffraction = false};
  const bool has_direct = effects.in_sight && EarlyCandidates::set_direct(scene, first_in_sight->at, listener, direct);

  SpherePaths paths(scene);
  const std::vector<Arrival> images = arrivals;
  // In the shadow the field is smooth over the sphere: one pair in four stands for all.
  const bool thin = !effects.in_sight && points.size() >= kLeastToThin;
  std::size_t count = 0;
  for (std::size_t i = 0; i < points.size(); ++i) {
    if (const std::size_t pair = i / 2; thin && pair % 4 != kUsedOfFour[pair / 4 % 4]) continue;
    const SpherePoint& point = points[i];
    ++count;
    arrivals = images;
    if (Arrival straight; point.in_sight && EarlyCandidates::set_direct(scene, point.at, listener, straight))
      arrivals.insert(arrivals.begin(), straight);
    const int over_edges = candidates.diffraction().find_arrivals_from(scene, point.at, listener, point.in_sight, arrivals);
    effects.diffraction = effects.diffraction || over_edges > 0;
    if (!point.in_sight && scene.plan().straight_transmission) {
      effects.transmission = true;
      find_transmitted_behind_walls(scene, point.at, listener, arrivals);
    }
    if (has_direct && !point.in_sight) {
      paths.add_hidden(arrivals, direct);
    } else {
      for (const Arrival& arrival : arrivals) paths.add(arrival);
    }
  }
  paths.finish(count, arrivals);
  return effects;
}

}  // namespace earshot
