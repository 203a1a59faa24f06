// SPDX-License-Identifier: Apache-2.0
#include <algorithm>
#include <array>
#include <cmath>
#include <glm/geometric.hpp>
#include <numbers>
#include <optional>
#include <tuple>
#include <utility>

#include "sim/acoustics/geometry/exact_plane.h"
#include "sim/acoustics/paths/early_reflections.h"
#include "sim/acoustics/paths/edge_reflections.h"
#include "sim/acoustics/paths/line_of_sight.h"
#include "sim/acoustics/paths/panel_reflection.h"
#include "sim/acoustics/paths/path_level.h"
#include "sim/base/coordinates.h"

namespace earshot {
namespace {

constexpr double kLeastOfDirect = 0.01;        // pressure of a panel's wave, in its loudest band
constexpr double kInset = 0.02;                // of rays to a panel
constexpr double kOffPanelM = 1e-3;            // of their ends from it
constexpr std::uint32_t kPanelBit = 1U << 30;  // tells panels from edges in an identity

std::uint64_t wave_identity(const PanelShape& panel, std::uint32_t index) {
  return path_identity(ArrivalKind::diffraction, std::array{panel.plane | kPanelBit, index});
}

bool comes_first(glm::dvec3 a, glm::dvec3 b) { return std::tie(a.x, a.y, a.z) < std::tie(b.x, b.y, b.z); }

}  // namespace

void EarlyCandidates::add_folds(const AcousticScene& scene) {
  const auto num_planes = static_cast<std::uint32_t>(scene.planes().size());
  const FoldedPlanes& folds = scene.folds();
  const auto no_fold = static_cast<std::uint32_t>(folds.planes.size());
  // Triangles of one plane may lie in several folds.
  std::vector<std::vector<std::uint32_t>> of_plane(num_planes);
  for (std::size_t triangle = 0; triangle < folds.fold_of_triangle.size(); ++triangle) {
    const std::uint32_t fold = folds.fold_of_triangle[triangle];
    auto& known = of_plane[scene.plane_of_triangle()[triangle]];
    if (fold != no_fold && std::find(known.begin(), known.end(), fold) == known.end()) known.push_back(fold);
  }
  std::vector<Sequence> by_folds;
  for (std::size_t i = 0; i < num_by_planes_; ++i) {
    std::vector<Sequence> choices = {{}};
    for (int n = 0; n < sequences_[i].order; ++n) {
      const std::uint32_t plane = sequences_[i].plane[n];
      std::vector<Sequence> longer;
      for (const Sequence& prefix : choices) {
        const auto append = [&](std::uint32_t next) {
          longer.push_back(prefix);
          longer.back().plane[n] = next;
          ++longer.back().order;
        };
        for (const std::uint32_t fold : of_plane[plane]) {
          if (n == 0 || prefix.plane[n - 1] != num_planes + fold) append(num_planes + fold);
        }
        append(plane);
      }
      choices = std::move(longer);
    }
    for (const Sequence& choice : choices) {
      if (std::any_of(choice.plane.begin(), choice.plane.begin() + choice.order, [&](std::uint32_t plane) { return plane >= num_planes; }))
        by_folds.push_back(choice);
    }
  }
  std::sort(by_folds.begin(), by_folds.end());
  by_folds.erase(std::unique(by_folds.begin(), by_folds.end()), by_folds.end());
  sequences_.insert(sequences_.end(), by_folds.begin(), by_folds.end());
}

bool EarlyCandidates::weigh_folds(const AcousticScene& scene, std::span<const std::uint32_t> met, std::span<const std::uint32_t> fold,
                                  bool by_folds, glm::vec3 listener, std::span<double> energy_fraction) const {
  const auto num_planes = static_cast<std::uint32_t>(scene.planes().size());
  const FoldedPlanes& folds = scene.folds();
  // The path by folds that stands for this one: twice in a row in the planes of one fold is once in it.
  std::array<std::uint32_t, kMaxOrder> instead{};
  std::size_t count = 0;
  double deepest_m = 0;
  bool outside = true;
  for (std::size_t i = 0; i < met.size(); ++i) {
    const bool folded = fold[i] < folds.planes.size();
    const std::uint32_t next = folded ? num_planes + fold[i] : met[i];
    if (folded) {
      const ExactPlane plane(folds.planes[fold[i]]);
      const double depth_m = double{folds.depth_m[fold[i]]};
      deepest_m = std::max(deepest_m, depth_m);
      outside = outside && std::abs(plane.height(glm::dvec3(listener))) > depth_m && std::abs(plane.height(glm::dvec3(source()))) > depth_m;
    }
    if (count == 0 || instead[count - 1] != next) instead[count++] = next;
  }
  if (deepest_m == 0) return !by_folds;
  // Between the top and the bottom of a fold there are only its planes; the tracers handle paths over other planes.
  if (by_folds ? !outside || !contains(met)
               : !outside || !find_sequence(std::span(instead).first(count), num_by_planes_, sequences_.size()))
    return !by_folds;
  bool is_audible = false;
  for (int band = 0; band < scene.num_bands(); ++band) {
    const double longer_m = 2.0 * deepest_m, waves = longer_m * scene.bands().centre_hz[band] / scene.speed_of_sound_m_per_s();
    const double one_mirror = boundary_weight(2.0 * waves);  // 1 up to an eighth of a wave, 0 from a quarter on
    energy_fraction[band] *= by_folds ? one_mirror : 1.0 - one_mirror;
    is_audible = is_audible || energy_fraction[band] > 0;
  }
  return is_audible;
}

void EarlyCandidates::find_panel_waves(const AcousticScene& scene, glm::vec3 listener, bool with_standing, std::vector<Arrival>& arrivals,
                                       std::vector<Arrival>* scattered) const {
  const glm::dvec3 from(source()), to(listener);
  const std::size_t first = arrivals.size();
  for (const std::uint32_t index : diffraction_.panels()) {
    const PanelShape& panel = scene.panel_shapes()->all()[index];
    if (panel.stands() || !panel.faces(to)) continue;
    const PanelWave wave(panel, from, to);
    if (wave.in_sight()) continue;  // an image path, or the tracers'
    const glm::dvec3 departure = wave.at() - from, arrival_way = wave.at() - to;
    const double departure_m = glm::length(departure), arrival_m = glm::length(arrival_way), distance_m = departure_m + arrival_m;
    if (distance_m > scene.max_path_m()) continue;
    // Rays to a point a little inside: the first thing that they meet is the panel.
    const glm::dvec3 inside = wave.at() + kInset * (panel.centre - wave.at());
    const double inside_m = glm::length(inside - to);
    const StandingPanels standing(scene, with_standing ? diffraction_.panels() : std::span<const std::uint32_t>(), panel.plane);
    const Hit hit = standing.hit_past(listener, glm::vec3((inside - to) / inside_m));
    if (!hit.valid() || scene.plane_of_triangle()[hit.triangle] != panel.plane) continue;
    if (!standing.is_free(offset_from_surface(hit.position, glm::vec3(panel.normal)), source())) continue;
    const std::uint32_t material = scene.scene().mesh().triangle_material[hit.triangle];
    Arrival path;
    path.kind = ArrivalKind::diffraction;
    path.identity = wave_identity(panel, index);
    path.order = 1;
    path.distance_m = static_cast<float>(distance_m);
    path.direction = glm::vec3(arrival_way / arrival_m);
    path.departure = glm::vec3(departure / departure_m);
    // As of the image in its endless plane, which it joins.
    const double cosine = std::min(glm::dot(from - panel.centre + to - panel.centre, panel.normal) / wave.image_m(), 1.0);
    std::array<double, kMaxBands> fraction{};
    for (const EdgeBands& bands : diffraction_.bands()) {
      const PanelReflection::Factor factor = wave.factor(bands.wave);
      for (int lane = 0; lane < bands.count; ++lane) {
        const int band = bands.first + lane;
        const MirrorReflection reflection = mirror_reflection(scene, material, band, cosine);
        // Of an image: of its length, whatever the way.
        fraction[band] = double{factor.energy[lane]} * std::pow(distance_m / wave.image_m(), 2) * reflection.energy_fraction;
        path.phase_rad[band] = static_cast<float>(
            std::remainder(double{factor.phase_rad[lane]} + bands.wave.exact[lane] * (distance_m - wave.image_m()) + reflection.phase_rad,
                           2.0 * std::numbers::pi));
      }
    }
    if (set_amplitude(scene, distance_m, fraction, path)) arrivals.push_back(path);
  }
  keep_strongest(scene, listener, first, arrivals, scattered);
}

void EarlyCandidates::keep_strongest(const AcousticScene& scene, glm::vec3 listener, std::size_t first, std::vector<Arrival>& arrivals,
                                     std::vector<Arrival>* scattered) const {
  const double straight_m = std::max(glm::length(glm::dvec3(listener) - glm::dvec3(source())), 0.1);
  const double least_energy = std::pow(kLeastOfDirect * 0.25 * std::numbers::inv_pi / straight_m, 2);
  std::size_t kept = first;
  for (std::size_t i = first; i < arrivals.size(); ++i) {
    double most = 0;
    for (int band = 0; band < scene.num_bands(); ++band)
      most = std::max(most, double{arrivals[i].amplitude[band]} * arrivals[i].amplitude[band]);
    if (most >= least_energy) {
      arrivals[kept++] = arrivals[i];
    } else if (scattered != nullptr) {
      scattered->push_back(arrivals[i]);
    }
  }
  arrivals.resize(kept);
  // The strongest stay paths; each of those is filtered.
  const auto level = [&](const Arrival& path) { return level_db(path, scene.num_bands()); };
  while (arrivals.size() - first > kMostPanelPaths) {
    const auto weakest = std::min_element(arrivals.begin() + static_cast<std::ptrdiff_t>(first), arrivals.end(),
                                          [&](const Arrival& a, const Arrival& b) { return level(a) < level(b); });
    if (scattered != nullptr) scattered->push_back(*weakest);
    arrivals.erase(weakest);
  }
}

namespace {

ComplexLanes pressure_of(const PanelReflection::Factor& factor) { return root_of(factor.energy) * unit_phase(factor.phase_rad); }

/// What a standing panel sends from the source and from its image in the base, relative to the images in the panel.
struct StandingWaves {
  ComplexLanes alone, by_base;
};

/// Waves of the doubled panel.  A base of finite size reflects less than the plane that doubles the panel: its pressures at the panel,
/// r from the source and s from the listener, weigh the wave by the base with (r + s) / 2; where the panel is small against the wave its
/// upper half is heard alone too, and the direct wave has (1 + r s) / 2.  So a small panel's two waves have (1 + r)(1 + s) / 2 of the
/// doubled one, from the whole of both to a half of one, and a large panel's own reflection is whole.
StandingWaves standing_waves(const WaveLanes& wave, const PanelShape& panel, const PanelWave& alone, const PanelWave& by_base,
                             const std::array<PanelWave, 2>* at_panel) {
  StandingWaves waves{pressure_of(alone.factor(wave)), pressure_of(by_base.factor(wave))};
  if (at_panel == nullptr) return waves;
  const ComplexLanes r = pressure_of((*at_panel)[0].factor(wave)), s = pressure_of((*at_panel)[1].factor(wave));
  const Lanes half_small = 0.5f * smallness_of(panel, wave);
  ComplexLanes missing = half_small * (r * s);
  missing.real += 1.f - half_small;
  waves.alone = waves.alone * missing;
  waves.by_base = all_lanes(0.5f) * (waves.by_base * (r + s));
  return waves;
}

/// Between the two faces of a standing panel; 0 of a sheet.
double thickness_m(const AcousticScene& scene, const PanelShape& panel) {
  if (panel.back_plane == panel.plane || panel.back_plane == PanelShape::kNone) return 0;
  return std::abs(ExactPlane(scene.planes()[panel.back_plane]).height(panel.centre + 0.5 * panel.height_m() * panel.up));
}

/// Sets amplitudes and phases of a wave over a way of distance_m, relative to an image at image_m.  Returns false if silent.
template <class Gain>
bool set_wave(const AcousticScene& scene, std::span<const EdgeBands> groups, std::span<const ComplexLanes> pressure, double image_m,
              double distance_m, const Gain& gain, Arrival& path) {
  std::array<double, kMaxBands> fraction{};
  for (std::size_t group = 0; group < groups.size(); ++group) {
    const EdgeBands& bands = groups[group];
    const Lanes energy = norm(pressure[group]), phase = argument(pressure[group]);
    for (int lane = 0; lane < bands.count; ++lane) {
      const int band = bands.first + lane;
      const MirrorReflection reflection = gain(bands.wave.exact[lane], band);
      fraction[band] = double{energy[lane]} * std::pow(distance_m / image_m, 2) * reflection.energy_fraction;
      path.phase_rad[band] = static_cast<float>(std::remainder(
          double{phase[lane]} + bands.wave.exact[lane] * (distance_m - image_m) + reflection.phase_rad, 2.0 * std::numbers::pi));
    }
  }
  path.distance_m = static_cast<float>(distance_m);
  return set_amplitude(scene, distance_m, fraction, path);
}

}  // namespace

void EarlyCandidates::find_standing_waves(const AcousticScene& scene, glm::vec3 listener, std::vector<Arrival>& arrivals,
                                          std::vector<Arrival>* scattered) const {
  const std::span<const PanelShape> shapes = scene.panel_shapes()->all();
  const std::span<const EdgeBands> groups = diffraction_.bands();
  const glm::dvec3 from(source()), to(listener);
  const std::size_t first = arrivals.size();
  const auto find = [&](std::uint64_t identity) {
    const auto end = arrivals.begin() + static_cast<std::ptrdiff_t>(first);
    const auto found = std::find_if(arrivals.begin(), end, [&](const Arrival& path) { return path.identity == identity; });
    return found == end ? nullptr : &*found;
  };
  std::array<ComplexLanes, (kMaxBands + kLanes - 1) / kLanes> alone_pressure, by_base_pressure;
  for (const std::uint32_t index : diffraction_.panels()) {
    const PanelShape& panel = shapes[index];
    if (!panel.stands() || !(glm::dot(to - panel.centre, panel.up) > 1e-3)) continue;
    const double side_m = glm::dot(to - panel.centre, panel.normal);
    if (std::abs(side_m) < 1e-3) continue;
    // On the other side a screen sends what it sends to the mirrored place, turned round: the shadow.
    const bool reflects = side_m > 0;
    const glm::dvec3 end = reflects ? to : panel.mirrored(to);
    const bool source_first = comes_first(from, end);
    const glm::dvec3 a = source_first ? from : end, b = source_first ? end : from;
    const PanelWave alone(panel, a, b), by_base(panel, panel.in_base(a), b);
    const auto upper = [&](glm::dvec3 point) {
      const double height_m = glm::dot(point - panel.centre, panel.up);
      return point + (std::clamp(std::abs(height_m), kInset * panel.height_m(), (1 - kInset) * panel.height_m()) - height_m) * panel.up;
    };
    const StandingPanels standing(scene, diffraction_.panels(), panel.base_plane);
    const double listener_off_m = reflects ? kOffPanelM : -(thickness_m(scene, panel) + kOffPanelM);
    const auto way_m = [&](glm::dvec3 start, glm::dvec3 point) { return glm::length(point - start) + glm::length(b - point); };
    const double alone_m = way_m(a, alone.at()), by_base_m = way_m(panel.in_base(a), by_base.at());
    const auto is_heard = [&](const PanelWave& wave, double distance_m) {
      const glm::dvec3 at = upper(wave.at());
      return distance_m <= scene.max_path_m() && standing.is_free(source(), glm::vec3(at + kOffPanelM * panel.normal)) &&
             standing.is_free(listener, glm::vec3(at + listener_off_m * panel.normal));
    };
    const bool alone_is_heard = is_heard(alone, alone_m), by_base_is_heard = is_heard(by_base, by_base_m);
    if (!alone_is_heard && !by_base_is_heard) continue;
    const glm::dvec3 middle =
        panel.centre + glm::dot(alone.at() - panel.centre, panel.axis[0]) * panel.axis[0] + 0.5 * panel.height_m() * panel.up;
    std::optional<std::array<PanelWave, 2>> at_panel;
    if (panel.base_panel != PanelShape::kNone)
      at_panel = {PanelWave(shapes[panel.base_panel], from, middle), PanelWave(shapes[panel.base_panel], to, middle)};
    for (std::size_t group = 0; group < groups.size(); ++group) {
      const StandingWaves waves = standing_waves(groups[group].wave, panel, alone, by_base, at_panel ? &*at_panel : nullptr);
      alone_pressure[group] = waves.alone;
      by_base_pressure[group] = waves.by_base;
    }
    const std::uint32_t material = scene.planes()[panel.plane].material, base_material = scene.planes()[panel.base_plane].material;
    const auto cosine = [](double heights_m, double image_m) { return std::min(std::abs(heights_m) / image_m, 1.0); };
    const double up_m = glm::dot(from + to - 2.0 * panel.centre, panel.up), off_m = glm::dot(from + end - 2.0 * panel.centre, panel.normal);
    const auto by = [&](std::uint32_t slot, int band, double at) { return mirror_reflection(scene, slot, band, at); };
    Arrival path;
    path.kind = ArrivalKind::diffraction;
    path.order = 1;
    if (!reflects) {
      const auto turned = [](double energy, double phase_rad) { return MirrorReflection{energy, phase_rad + std::numbers::pi}; };
      Arrival* const base = [&]() -> Arrival* {
        if (!by_base_is_heard) return nullptr;
        const std::uint32_t plane = panel.base_plane;
        Arrival* const image = find(path_identity(ArrivalKind::reflection, std::span(&plane, 1)));
        return image != nullptr || panel.base_panel == PanelShape::kNone ? image
                                                                         : find(wave_identity(shapes[panel.base_panel], panel.base_panel));
      }();
      if (base != nullptr && set_wave(
                                 scene, groups, by_base_pressure, by_base.image_m(), by_base_m,
                                 [&](double, int band) {
                                   const MirrorReflection reflection = by(base_material, band, cosine(up_m, by_base.image_m()));
                                   return turned(reflection.energy_fraction, reflection.phase_rad);
                                 },
                                 path))
        add_wave(groups, path, *base);
      // Near the shadow's boundary the wave of the rim is part of the direct sound already (diffraction_paths.h).
      Arrival* const direct = alone_is_heard ? find(path_identity(ArrivalKind::direct, {})) : nullptr;
      if (direct != nullptr && set_wave(
                                   scene, groups, alone_pressure, alone.image_m(), alone_m,
                                   [&](double wavenumber, int) {
                                     const double waves = wavenumber * (alone_m - alone.image_m()) * 0.5 * std::numbers::inv_pi;
                                     return turned(std::pow(1.0 - boundary_weight(waves), 2), 0);
                                   },
                                   path))
        add_wave(groups, path, *direct);
      continue;
    }
    const auto send = [&](const PanelWave& wave, std::span<const ComplexLanes> pressure, double distance_m, bool by_the_base) {
      const std::array<std::uint32_t, 3> met = {panel.plane | kPanelBit, index, panel.base_plane};
      path.identity = path_identity(path.kind, std::span(met).first(by_the_base ? 3 : 2));
      path.order = by_the_base ? 2 : 1;
      const glm::dvec3 at = wave.at(), other = by_the_base ? panel.in_base(at) : at;
      path.direction = glm::vec3(glm::normalize((source_first ? at : other) - to));
      path.departure = glm::vec3(glm::normalize((source_first ? other : at) - from));
      const double own = cosine(off_m, wave.image_m()), base = cosine(up_m, wave.image_m());
      const bool is_audible = set_wave(
          scene, groups, pressure, wave.image_m(), distance_m,
          [&](double, int band) {
            MirrorReflection reflection = by(material, band, own);
            if (by_the_base) {
              const MirrorReflection more = by(base_material, band, base);
              reflection.energy_fraction *= more.energy_fraction;
              reflection.phase_rad += more.phase_rad;
            }
            return reflection;
          },
          path);
      if (is_audible) arrivals.push_back(path);
    };
    if (alone_is_heard) send(alone, alone_pressure, alone_m, false);
    if (by_base_is_heard) send(by_base, by_base_pressure, by_base_m, true);
  }
  keep_strongest(scene, listener, first, arrivals, scattered);
}

bool EarlyCandidates::is_standing_wave(const AcousticScene& scene, std::span<const std::uint32_t> planes,
                                       std::span<const glm::dvec3> points) const {
  if (planes.size() > 2) return false;
  for (std::size_t i = 0; i < planes.size(); ++i)
    for (const std::uint32_t index : diffraction_.panels()) {
      const PanelShape& panel = scene.panel_shapes()->all()[index];
      if (panel.stands() && panel.plane == planes[i] && panel.holds(points[i]) && (planes.size() == 1 || planes[1 - i] == panel.base_plane))
        return true;
    }
  return false;
}

}  // namespace earshot
