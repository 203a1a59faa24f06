// SPDX-License-Identifier: Apache-2.0
#include "sim/acoustics/response/late_edges.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <glm/geometric.hpp>
#include <limits>
#include <numbers>
#include <span>

#include "sim/acoustics/core/sampling.h"
#include "sim/acoustics/paths/diffraction_paths.h"
#include "sim/base/random.h"

namespace earshot {
namespace {

constexpr std::uint32_t kLongestWalk = 200;
constexpr double kWalkEndsAt = 1e-4;  // of the energy of a walk, in its loudest band

using Energies = std::array<double, kMaxBands>;

/// Walks from one end, with what their surface points send to the other.
class EdgeWalks {
 public:
  /// emission: of the end that walks begin at; null: even.
  EdgeWalks(const AcousticScene& scene, glm::vec3 from, const Emission* emission, glm::vec3 to)
      : scene_(scene),
        from_(from),
        to_(to),
        emission_(emission),
        edges_(scene, to),
        num_bands_(static_cast<std::size_t>(scene.num_bands())) {}

  /// side: of the random numbers.
  void walk(std::uint32_t number, std::uint32_t side) {
    const RandomStream random(scene_.config().seed, Purpose::late_edges, number, side);
    const auto first = random.uniform2(0);
    glm::vec3 origin = from_, direction = sphere_direction(first[0], first[1]);
    Energies energy;
    energy.fill(1.0);
    if (emission_ != nullptr && !emission_->omnidirectional()) {
      std::array<float, kMaxBands> gain{};
      emission_->energy(direction, std::span(gain).first(num_bands_));
      std::copy(gain.begin(), gain.end(), energy.begin());
    }
    double path_m = 0, loudest = 1;
    for (std::uint32_t bounce = 1; bounce <= kLongestWalk && loudest > kWalkEndsAt; ++bounce) {
      const Hit hit = scene_.scene().rays().intersect(origin, direction);
      path_m += double{hit.distance_m};
      if (!hit.valid() || path_m > double{scene_.max_path_m()}) return;
      const std::uint32_t material = scene_.scene().mesh().triangle_material[hit.triangle];
      loudest = 0;
      for (std::size_t band = 0; band < num_bands_; ++band)
        loudest = std::max(loudest, energy[band] *= double{scene_.reflectance(material)[band]});
      origin = offset_from_surface(hit.position, hit.normal);
      send(origin, hit.normal, path_m, energy);
      float scattering = 0;
      for (const float s : scene_.scattering(material)) scattering += s / static_cast<float>(num_bands_);
      const auto u = random.uniform4(bounce);
      direction = u[2] < scattering ? lambert_direction(hit.normal, u[0], u[1]) : mirror_direction(direction, hit.normal);
    }
  }
  [[nodiscard]] const Energies& straight() const { return straight_; }
  [[nodiscard]] const Energies& round_edges() const { return round_edges_; }

 private:
  /// From a surface point after Lambert, over pi times the cosine of what leaves; in units of the mean square pressure of a unit source.
  void send(glm::vec3 point, glm::vec3 normal, double path_m, const Energies& energy) {
    if (scene_.scene().rays().occluded(point, to_)) {
      arrivals_.clear();
      edges_.find_arrivals(scene_, point, false, arrivals_);
      for (const Arrival& arrival : arrivals_) {
        const double cosine = double{glm::dot(normal, arrival.direction)};
        if (!(cosine > 0)) continue;
        for (std::size_t band = 0; band < num_bands_; ++band)
          round_edges_[band] +=
              energy[band] * air(band, path_m) * cosine * double{arrival.amplitude[band]} * double{arrival.amplitude[band]};
      }
      return;
    }
    const glm::dvec3 toward = glm::dvec3(to_) - glm::dvec3(point);
    const double distance_m = std::max(glm::length(toward), double{scene_.diagonal_m()} * 1e-3),
                 cosine = glm::dot(toward, glm::dvec3(normal)) / distance_m;
    if (!(cosine > 0)) return;
    const double amplitude = 1.0 / (4.0 * std::numbers::pi * distance_m);
    for (std::size_t band = 0; band < num_bands_; ++band)
      straight_[band] += energy[band] * air(band, path_m + distance_m) * cosine * amplitude * amplitude;
  }
  [[nodiscard]] double air(std::size_t band, double path_m) const { return std::exp(-double{scene_.air_energy_per_m()[band]} * path_m); }

  const AcousticScene& scene_;
  glm::vec3 from_, to_;
  const Emission* emission_;
  DiffractionCandidates edges_;
  std::size_t num_bands_;
  Energies straight_{}, round_edges_{};
  std::vector<Arrival> arrivals_;
};

}  // namespace

std::vector<double> LateEdges::change_db() const {
  std::vector<double> db;
  for (const double x : fraction) db.push_back(10.0 * std::log10(1.0 + x));
  return db;
}

LateEdges late_edges(const AcousticScene& scene, const SoundSource& source, glm::vec3 listener) {
  const auto num_bands = static_cast<std::size_t>(scene.num_bands());
  LateEdges result{.fraction = std::vector<double>(num_bands, 0.0)};
  if (scene.diffraction_edges() == nullptr || scene.diffraction_edges()->size() == 0) return result;
  const Emission emission(source, scene.bands());
  EdgeWalks to_listener(scene, source.position, &emission, listener), to_source(scene, listener, nullptr, source.position);
  for (std::uint32_t i = 0; i < kLateEdgeWalks; ++i) {
    to_listener.walk(i, 0);
    to_source.walk(i, 1);
  }
  for (std::size_t band = 0; band < num_bands; ++band) {
    // Both sides estimate the same late energy; with a directional source only the first does.
    const double both =
        emission.omnidirectional() ? 0.5 * (to_listener.straight()[band] + to_source.straight()[band]) : to_listener.straight()[band];
    double at_source = to_source.round_edges()[band];
    if (!emission.omnidirectional() && at_source > 0)
      at_source = to_source.straight()[band] > 0 ? at_source / to_source.straight()[band] * to_listener.straight()[band]
                                                 : std::numeric_limits<double>::infinity();
    const double round_edges = to_listener.round_edges()[band] + at_source;
    result.fraction[band] = round_edges > 0 ? (both > 0 ? round_edges / both : std::numeric_limits<double>::infinity()) : 0.0;
  }
  return result;
}

}  // namespace earshot
