// SPDX-License-Identifier: Apache-2.0
#include "sim/acoustics/model/wall_power.h"

#include <algorithm>
#include <cmath>
#include <glm/geometric.hpp>
#include <limits>
#include <numbers>
#include <optional>

#include "sim/acoustics/core/boundary_weight.h"
#include "sim/acoustics/geometry/exact_plane.h"
#include "sim/acoustics/model/acoustic_surfaces.h"
#include "sim/acoustics/model/effect_plan.h"
#include "sim/base/memory_bytes.h"

namespace earshot {
namespace {

constexpr std::size_t kTableSize = 2048;
constexpr double kTableStep = 0.06;          // radians: the table ends at 123, where S of an octave is below 3e-4
constexpr std::size_t kEdgeTableSize = 700;  // to 42, where E0 of an octave is below 1e-3
constexpr std::size_t kMostWalls = 4096;     // the largest
constexpr float kMinAreaM2 = 0.04f;          // of a plane
constexpr double kReachOfPanel = 4.0;        // times the root of its area: longer waves hardly notice it
constexpr double kLeastHeightM = 0.01;       // from where rays start
constexpr double kSlackM = 2e-3;             // of bounds, and of the length of rays
constexpr double kLeastGain = 0.1;           // sums over few images may fall below what is possible
constexpr double kLeastEffect = 0.003;       // of a wall or an edge: 0.013 dB
constexpr double kSquareCosine = 0.26;       // of edges that make a corner: 75 to 105 degrees
constexpr double kLeastEdgeRad = 50.0 * std::numbers::pi / 180.0;

/// Sine integral, absolute error below 1e-6 (Abramowitz and Stegun, 5.2.8, 5.2.14, 5.2.38 and 5.2.39).
double sine_integral(double x) {
  if (x < 1.0) {
    const double y = x * x;
    return x * (1.0 - y / 18.0 * (1.0 - 3.0 * y / 100.0 * (1.0 - 5.0 * y / 294.0)));
  }
  const double y = x * x;
  const double f = (((y + 38.027264) * y + 265.187033) * y + 335.677320) * y + 38.102495;
  const double f_under = (((y + 40.021433) * y + 322.624911) * y + 570.236280) * y + 157.105423;
  const double g = (((y + 42.242855) * y + 302.757865) * y + 352.018498) * y + 21.821899;
  const double g_under = (((y + 48.196927) * y + 482.485984) * y + 1114.978885) * y + 449.690326;
  return 0.5 * std::numbers::pi - f / (x * f_under) * std::cos(x) - g / (y * g_under) * std::sin(x);
}

/// Integral of J1(t) / t from x on, for x in steps of kShadowStep: that of J0 by Simpson's rule, and (t E)' = E - J1.
constexpr double kShadowStep = 0.04;
std::vector<double> edge_shadows(double last) {
  std::vector<double> shadow{1.0};
  double sum = 0;  // of J0
  for (double x = 0; x < last + kShadowStep; x = kShadowStep * static_cast<double>(shadow.size() - 1)) {
    sum += kShadowStep / 6.0 * (::j0(x) + 4.0 * ::j0(x + 0.5 * kShadowStep) + ::j0(x + kShadowStep));
    shadow.push_back(1.0 - sum + ::j1(x + kShadowStep));
  }
  return shadow;
}

/// Length of a rigid plate against which the wave counts, D of wall_power.h.
double plate_length(const std::array<double, 2>& sides_m) {
  const double shorter = 0.5 * std::min(sides_m[0], sides_m[1]), longer = 0.5 * std::max(sides_m[0], sides_m[1]);
  if (!(shorter < std::numeric_limits<double>::infinity())) return shorter;
  return 1.06 * shorter / (1.0 + (0.5 * std::numbers::pi - 1.0) * std::pow(shorter / longer, 1.5));  // E within 1 %
}

/// How much a plane of this area may count, about.
double size_weight(double area_m2, double wavenumber) {
  const double half_m = std::numbers::pi / wavenumber, size = area_m2 / (half_m * half_m);
  return -std::expm1(-size * size);
}

}  // namespace

double band_mean_sinc(double low_hz, double high_hz, double distance_m, double speed_m_per_s) {
  const double per_hz = 2.0 * std::numbers::pi / speed_m_per_s * distance_m, low = per_hz * low_hz, high = per_hz * high_hz;
  // Of a short or a narrow band the integral loses its digits: the mean of sin x / x is that of its ends and its middle (Simpson).
  if (high - low < 0.05) {
    const auto sinc = [](double x) { return x < 1e-3 ? 1.0 - x * x / 6.0 : std::sin(x) / x; };
    return (sinc(low) + 4.0 * sinc(0.5 * (low + high)) + sinc(high)) / 6.0;
  }
  return (sine_integral(high) - sine_integral(low)) / (high - low);
}

/// A wall near a point.
struct WallPower::Near {
  const MirrorPlane* plane;
  std::uint32_t index;           // planes().size() and more: a fold
  std::uint32_t material, fold;  // of the triangle at its foot; folds.planes.size(): not in a fold
  glm::dvec3 normal;             // unit, toward the point
  double height_m;
  const WallFacet* facet;  // that its foot lies on
  [[nodiscard]] bool holds(glm::dvec3 p) const {
    return glm::all(glm::greaterThanEqual(p, glm::dvec3(plane->bounds.lower) - kSlackM)) &&
           glm::all(glm::lessThanEqual(p, glm::dvec3(plane->bounds.upper) + kSlackM)) && facet->reaches(p);
  }
  std::array<double, kMaxBands> weight, alone, in_pair;  // c of a band; times what its own term is; times what is left of pairs
};

struct WallPower::NearWalls {
  glm::dvec3 point, origin;  // origin of rays: the point, kLeastHeightM away from walls that it touches
  std::array<Near, kMaxNear> wall;
  std::size_t count = 0;
};

WallPower::WallPower(const AcousticSurfaces& surfaces, bool all_bands)
    : all_bands_(all_bands),
      least_effect_(all_bands ? 0.0 : kLeastEffect),
      num_bands_(static_cast<std::size_t>(surfaces.num_bands())),
      facets_(surfaces.scene(), surfaces.planes(), surfaces.plane_of_triangle(), surfaces.folds(), double{kMinAreaM2}, kMostWalls) {
  const double speed = surfaces.speed_of_sound_m_per_s();
  const BandLayout& bands = surfaces.bands();
  reach_m_ = speed / bands.centre_hz.front();
  table_.resize(num_bands_ * kTableSize);
  edge_table_.resize(num_bands_ * kTableSize);  // 0 from kEdgeTableSize on
  double widest = 0;
  for (std::size_t band = 0; band < num_bands_; ++band) widest = std::max(widest, double{bands.edge_hz[band + 1]} / bands.centre_hz[band]);
  const std::vector<double> shadow = edge_shadows(widest * static_cast<double>(kEdgeTableSize) * kTableStep);
  const auto shadow_at = [&](double x) {
    const auto index = static_cast<std::size_t>(x / kShadowStep);
    return shadow[index] + (x / kShadowStep - static_cast<double>(index)) * (shadow[index + 1] - shadow[index]);
  };
  for (std::size_t band = 0; band < num_bands_; ++band) {
    wavenumber_.push_back(2.0 * std::numbers::pi * bands.centre_hz[band] / speed);
    for (std::size_t i = 0; i < kTableSize; ++i) {
      const double x = static_cast<double>(i) * kTableStep, low = x * bands.edge_hz[band] / bands.centre_hz[band],
                   high = x * bands.edge_hz[band + 1] / bands.centre_hz[band];
      table_[band * kTableSize + i] =
          static_cast<float>(band_mean_sinc(bands.edge_hz[band], bands.edge_hz[band + 1], x / wavenumber_.back(), speed));
      if (i >= kEdgeTableSize) continue;
      // The integral of E is t E - J0.
      const auto integral = [&](double t) { return t * shadow_at(t) - ::j0(t); };
      edge_table_[band * kTableSize + i] =
          static_cast<float>(high - low < 0.1 ? shadow_at(x) : (integral(high) - integral(low)) / (high - low));
    }
  }
  const auto add = [&](const MirrorPlane& plane, std::uint32_t index) {
    if (!(plane.area_m2 >= kMinAreaM2) || plane_.size() >= kMostWalls) return;
    plane_.push_back(index);
    offset_m_.push_back(plane.offset_m);
    for (const double wavenumber : wavenumber_) size_.push_back(static_cast<float>(size_weight(double{plane.area_m2}, wavenumber)));
    plane_reach_m_.push_back(static_cast<float>(std::min(reach_m_, kReachOfPanel * std::sqrt(double{plane.area_m2}))));
    for (int axis = 0; axis < 3; ++axis) {
      const auto a = static_cast<std::size_t>(axis);
      normal_[a].push_back(plane.normal[axis]);
      lower_[a].push_back(plane.bounds.lower[axis] - static_cast<float>(kSlackM));
      upper_[a].push_back(plane.bounds.upper[axis] + static_cast<float>(kSlackM));
    }
  };
  const auto num_planes = static_cast<std::uint32_t>(surfaces.planes().size());
  const std::vector<MirrorPlane>& folds = surfaces.folds().planes;
  for (std::uint32_t i = 0; i < folds.size(); ++i) add(folds[i], num_planes + i);
  for (std::uint32_t i = 0; i < num_planes; ++i) add(surfaces.planes()[i], i);
}

std::size_t WallPower::bytes() const {
  std::size_t sum = sizeof(WallPower) + bytes_of(wavenumber_) + bytes_of(table_) + bytes_of(edge_table_) + facets_.bytes() +
                    bytes_of(offset_m_) + bytes_of(plane_reach_m_) + bytes_of(size_) + bytes_of(plane_);
  for (std::size_t axis = 0; axis < 3; ++axis) sum += bytes_of(normal_[axis]) + bytes_of(lower_[axis]) + bytes_of(upper_[axis]);
  return sum;
}

double WallPower::look_up(const std::vector<float>& table, std::size_t band, double distance_m) const {
  const double at = wavenumber_[band] * distance_m / kTableStep;
  if (!(at < static_cast<double>(kTableSize - 1))) return 0.0;
  const auto index = static_cast<std::size_t>(at);
  const float* row = &table[band * kTableSize + index];
  return double{row[0]} + (at - static_cast<double>(index)) * (double{row[1]} - double{row[0]});
}

void WallPower::find_walls(const AcousticSurfaces& surfaces, glm::dvec3 point, NearWalls& walls) const {
  const auto num_planes = static_cast<std::uint32_t>(surfaces.planes().size());
  const FoldedPlanes& folds = surfaces.folds();
  const auto plane_at = [&](std::uint32_t index) -> const MirrorPlane& {
    return index < num_planes ? surfaces.planes()[index] : folds.planes[index - num_planes];
  };
  // Planes whose foot may lie on them, those that may matter most first, as many as fit.
  struct Found {
    std::uint32_t plane;
    double effect;
  };
  std::array<Found, kMaxNear> found;
  std::size_t count = 0;
  const auto x = static_cast<float>(point.x), y = static_cast<float>(point.y), z = static_cast<float>(point.z);
  for (std::size_t i = 0; i < plane_.size(); ++i) {
    const float height = normal_[0][i] * x + normal_[1][i] * y + normal_[2][i] * z - offset_m_[i];
    if (!(std::abs(height) <= plane_reach_m_[i])) continue;
    const float fx = x - height * normal_[0][i], fy = y - height * normal_[1][i], fz = z - height * normal_[2][i];
    if (!((fx >= lower_[0][i]) & (fx <= upper_[0][i]) & (fy >= lower_[1][i]) & (fy <= upper_[1][i]) & (fz >= lower_[2][i]) &
          (fz <= upper_[2][i])))
      continue;
    double effect = 0;
    for (std::size_t band = 0; band < num_bands_; ++band)
      effect = std::max(effect, double{size_[i * num_bands_ + band]} * std::abs(mean_sinc(band, 2.0 * std::abs(double{height}))));
    if (effect < least_effect_ || (count == kMaxNear && effect <= found[count - 1].effect)) continue;
    std::size_t at = count < kMaxNear ? count++ : count - 1;
    for (; at > 0 && found[at - 1].effect < effect; --at) found[at] = found[at - 1];
    found[at] = {plane_[i], effect};
  }
  walls.point = walls.origin = point;
  // Off the walls that it touches, of whatever part of them.
  for (const Found& near : std::span(found).first(count)) {
    const ExactPlane plane(plane_at(near.plane));
    const double height_m = plane.height(walls.origin);
    if (std::abs(height_m) >= kLeastHeightM) continue;
    walls.origin += (height_m < 0 ? -1.0 : 1.0) * (kLeastHeightM - std::abs(height_m)) * plane.normal;
  }
  walls.count = 0;
  for (const Found& near : std::span(found).first(count)) {
    const MirrorPlane& rounded = plane_at(near.plane);
    const ExactPlane plane(rounded);
    const bool is_fold = near.plane >= num_planes;
    const double start_m = plane.height(walls.origin), height_m = std::abs(plane.height(point));
    const double depth_m = is_fold ? double{folds.depth_m[near.plane - num_planes]} : 0.0;
    if (is_fold && height_m <= depth_m) continue;
    const glm::dvec3 toward = start_m < 0 ? -plane.normal : plane.normal;
    const Hit hit = surfaces.scene().rays().intersect(glm::vec3(walls.origin), glm::vec3(-toward));
    if (!hit.valid() || std::abs(hit.distance_m - std::abs(start_m)) > kSlackM + depth_m) continue;
    const std::uint32_t fold = folds.planes.empty() ? 0 : folds.fold_of_triangle[hit.triangle];
    if (is_fold ? fold != near.plane - num_planes : surfaces.plane_of_triangle()[hit.triangle] != near.plane) continue;
    const WallFacet* const facet = is_fold ? facets_.of_fold(fold) : facets_.of_triangle(hit.triangle);
    if (facet == nullptr) continue;
    Near& wall = walls.wall[walls.count++];
    wall.facet = facet;
    wall.plane = &rounded;
    wall.index = near.plane;
    wall.material = surfaces.scene().mesh().triangle_material[hit.triangle];
    wall.fold = fold;
    wall.normal = toward;
    wall.height_m = height_m;
  }
}

void WallPower::find_weights(const AcousticSurfaces& surfaces, NearWalls& walls) const {
  const auto num_planes = static_cast<std::uint32_t>(surfaces.planes().size());
  const FoldedPlanes& folds = surfaces.folds();
  for (Near& wall : std::span(walls.wall).first(walls.count)) {
    const bool is_fold = wall.index >= num_planes;
    // A plane of a fold that stands for it has the rest.
    const bool in_fold = wall.fold < folds.planes.size();
    const bool shared =
        in_fold && (is_fold || std::any_of(walls.wall.begin(), walls.wall.begin() + static_cast<std::ptrdiff_t>(walls.count),
                                           [&](const Near& other) { return other.index == num_planes + wall.fold; }));
    const auto reflectance = surfaces.reflectance(wall.material), scattering = surfaces.scattering(wall.material);
    for (std::size_t band = 0; band < num_bands_; ++band) {
      const double kept = double{reflectance[band]};
      double weight = 2.0 * std::sqrt(kept * (1.0 - double{scattering[band]})) / (1.0 + kept);
      if (shared) {
        // One mirror up to an eighth of a wave, none from a quarter on: as image paths share a fold between it and its planes.
        const double waves = 2.0 * double{folds.depth_m[wall.fold]} * wavenumber_[band] / (2.0 * std::numbers::pi);
        const double fold_weight = boundary_weight(2.0 * waves);
        weight *= is_fold ? fold_weight : 1.0 - fold_weight;
      }
      wall.weight[band] = weight;
    }
    end_in_air(wall, walls.point);
  }
}

void WallPower::end_in_air(Near& wall, glm::dvec3 point) const {
  const WallFacet::View view = wall.facet->view(point, glm::dot(wall.normal, wall.facet->normal) > 0);
  std::array<double, kMaxBands> lost{};  // T
  for (std::size_t a = 0; view.ends && a < 2; ++a)
    for (std::size_t end = 0; end < 2; ++end) {
      const double d = view.to_side_m[a][end], r = std::hypot(d, wall.height_m);
      if (!(r < reach_m_)) continue;
      const auto& beside = view.to_side_m[1 - a];
      const double fraction = view.weight[a][end] * (std::atan2(beside[0], d) + std::atan2(beside[1], d)) / std::numbers::pi;
      const double cosine = r > 0 ? d / r : 1.0;
      for (std::size_t band = 0; band < num_bands_; ++band)
        lost[band] += fraction * 0.5 * ((1.0 + cosine) * look_up(edge_table_, band, 2.0 * r) + (1.0 - cosine) * mean_sinc(band, 2.0 * r));
    }
  const double length_m = view.ends ? plate_length(view.length_m) : std::numeric_limits<double>::infinity();
  for (std::size_t band = 0; band < num_bands_; ++band) {
    const double size = wavenumber_[band] * length_m / 0.7, counts = -std::expm1(-size * size) * wall.weight[band];
    const double twice = 0.25 * lost[band] * lost[band], left = lost[band] > 0 ? twice * twice - lost[band] : -lost[band];
    const double mirror = mean_sinc(band, 2.0 * wall.height_m), alone = mirror + left;
    wall.alone[band] = counts * (lost[band] > 1.0 ? std::max(alone, std::min(mirror, 0.0)) : alone);
    wall.in_pair[band] = counts * std::clamp(1.0 + left, 0.0, 1.0);
  }
}

WallGain WallPower::at(const AcousticSurfaces& surfaces, glm::vec3 point) const {
  WallGain gain;
  NearWalls walls;
  find_walls(surfaces, glm::dvec3(point), walls);
  if (walls.count == 0) return gain;
  find_weights(surfaces, walls);
  std::array<double, kMaxBands> sum;
  sum.fill(1.0);
  const auto near = std::span(walls.wall).first(walls.count);
  for (const Near& wall : near)
    for (std::size_t band = 0; band < num_bands_; ++band) sum[band] += wall.alone[band];

  // Edges: of the point of the edge that is nearest, both walls must have it, and nothing may stand before it.
  const auto is_visible = [&](glm::dvec3 target) {
    const glm::dvec3 way = target - walls.origin;
    const double length_m = glm::length(way);
    if (length_m < 2.0 * kLeastHeightM) return true;
    const Hit hit = surfaces.scene().rays().intersect(glm::vec3(walls.origin), glm::vec3(way / length_m));
    return !hit.valid() || hit.distance_m > length_m - kSlackM - 1e-3 * length_m;
  };
  std::array<std::array<bool, kMaxNear>, kMaxNear> square_edge{};
  for (std::size_t i = 0; i < near.size(); ++i) {
    for (std::size_t j = i + 1; j < near.size(); ++j) {
      const Near &first = near[i], &second = near[j];
      const double cosine = glm::dot(first.normal, second.normal), sine2 = 1.0 - cosine * cosine;
      const double edge_rad = std::numbers::pi - std::acos(std::clamp(cosine, -1.0, 1.0));
      if (edge_rad < kLeastEdgeRad || sine2 < 1e-3) continue;
      const double along_first = (first.height_m - cosine * second.height_m) / sine2,
                   along_second = (second.height_m - cosine * first.height_m) / sine2;
      const glm::dvec3 way = along_first * first.normal + along_second * second.normal;
      const double distance_m = glm::length(way);
      const glm::dvec3 target = walls.point - way;
      if (distance_m > reach_m_ || !first.holds(target) || !second.holds(target)) continue;
      const double edge_weight = 2.0 * std::numbers::pi / edge_rad - 3.0;
      std::array<double, kMaxBands> added;
      double most = 0;
      for (std::size_t band = 0; band < num_bands_; ++band) {
        added[band] = edge_weight * first.in_pair[band] * second.in_pair[band] * mean_sinc(band, 2.0 * distance_m);
        most = std::max(most, std::abs(added[band]));
      }
      if (most < least_effect_ || !is_visible(target)) continue;
      square_edge[i][j] = std::abs(cosine) < kSquareCosine;
      for (std::size_t band = 0; band < num_bands_; ++band) sum[band] += added[band];
    }
  }
  // Corners of three such edges.
  for (std::size_t i = 0; i < near.size(); ++i)
    for (std::size_t j = i + 1; j < near.size(); ++j)
      for (std::size_t k = j + 1; square_edge[i][j] && k < near.size(); ++k) {
        if (!square_edge[i][k] || !square_edge[j][k]) continue;
        const glm::dmat3 rows = glm::transpose(glm::dmat3(near[i].normal, near[j].normal, near[k].normal));
        const glm::dvec3 way = glm::inverse(rows) * glm::dvec3(near[i].height_m, near[j].height_m, near[k].height_m);
        const double distance_m = glm::length(way);
        const glm::dvec3 target = walls.point - way;
        if (distance_m > reach_m_ || !near[i].holds(target) || !near[j].holds(target) || !near[k].holds(target)) continue;
        for (std::size_t band = 0; band < num_bands_; ++band)
          sum[band] += near[i].in_pair[band] * near[j].in_pair[band] * near[k].in_pair[band] * mean_sinc(band, 2.0 * distance_m);
      }

  for (std::size_t band = 0; band < num_bands_; ++band) {
    const double energy = std::max(sum[band], kLeastGain);
    if (!all_bands_ && std::abs(10.0 * std::log10(energy)) < kEffectBudgetDb) continue;
    gain.energy[band] = static_cast<float>(energy);
    gain.any = gain.any || gain.energy[band] != 1.f;
  }
  return gain;
}

}  // namespace earshot
