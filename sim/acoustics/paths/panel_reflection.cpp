// SPDX-License-Identifier: Apache-2.0
#include "sim/acoustics/paths/panel_reflection.h"

#include <algorithm>
#include <cmath>
#include <glm/geometric.hpp>
#include <limits>
#include <numbers>
#include <tuple>
#include <utility>

#include "sim/acoustics/core/arrival.h"
#include "sim/acoustics/paths/utd.h"

namespace earshot {
namespace {

constexpr double kEndless = std::numeric_limits<double>::infinity();

/// How much longer the shortest way from a to b over the edge's line is than the straight one.
double detour(const PanelEdge& edge, glm::dvec3 a, glm::dvec3 b, double straight_m) {
  const glm::dvec3 from_a = a - edge.start, from_b = b - edge.start;
  const double along_a = glm::dot(from_a, edge.along), along_b = glm::dot(from_b, edge.along);
  const double away = glm::length(from_a - along_a * edge.along) + glm::length(from_b - along_b * edge.along);
  return std::max(std::sqrt(away * away + (along_a - along_b) * (along_a - along_b)) - straight_m, 0.0);
}

}  // namespace

PanelReflection::PanelReflection(std::span<const PanelEdge> edges, glm::dvec3 image, glm::dvec3 listener, glm::dvec3 at,
                                 double longest_wave_m) {
  detour_m_.fill(kEndless);
  // The nearest edge beside the point gives the directions; the others count for the one that they face most.
  double nearest_m = kEndless;
  glm::dvec3 axis(0), across(0);
  const auto beside = [&](const PanelEdge& edge, double& distance_m) {
    if (glm::dot(edge.normal, listener - image) <= 0) return false;  // of the other side
    const glm::dvec3 from = at - edge.start;
    const double along_m = glm::dot(from, edge.along);
    distance_m = -glm::dot(from, edge.outward);
    return distance_m >= 0 && along_m >= 0 && along_m <= edge.length_m;
  };
  double distance_m;
  for (const PanelEdge& edge : edges) {
    if (!beside(edge, distance_m) || distance_m >= nearest_m) continue;
    nearest_m = distance_m;
    axis = edge.outward;
    across = edge.along;
  }
  if (nearest_m == kEndless) return;
  const double straight_m = glm::length(listener - image);
  std::array<double, 4> closest_m;
  closest_m.fill(kEndless);
  for (const PanelEdge& edge : edges) {
    if (!beside(edge, distance_m)) continue;
    const double along_axis = glm::dot(edge.outward, axis), along_across = glm::dot(edge.outward, across);
    const bool first = std::abs(along_axis) >= std::abs(along_across);
    const std::size_t side = first ? (along_axis > 0 ? 0 : 1) : (along_across > 0 ? 2 : 3);
    if (distance_m >= closest_m[side]) continue;
    closest_m[side] = distance_m;
    const double detour_m = detour(edge, image, listener, straight_m);
    detour_m_[side] = detour_m < 1.26 * longest_wave_m ? detour_m : kEndless;
    finite_ = finite_ || detour_m_[side] < kEndless;
  }
}

ComplexLanes PanelReflection::pressure_factor(const Lanes& wavenumber) const {
  constexpr auto pi = static_cast<float>(std::numbers::pi);
  const ComplexLanes unit = {all_lanes(1.f), {}};
  std::array<ComplexLanes, 2> inside = {unit, unit};
  for (std::size_t side = 0; side < 4; ++side) {
    if (detour_m_[side] == kEndless) continue;
    const Lanes long_phase = wavenumber * static_cast<float>(detour_m_[side]);
    const Lanes phase = long_phase < 2.f * pi ? long_phase : all_lanes(2.f * pi);
    // boundary_weight() of half the detour: 0 at the end.
    const Lanes weight = phase < pi ? all_lanes(1.f) : 0.5f + 0.5f * unit_phase(phase - pi).real;
    // The Fresnel integral past the edge, over the whole: half of exp(-j u^2) scaled_erfc(u), u^2 = k detour.
    inside[side / 2] = inside[side / 2] - (0.5f * weight) * (scaled_erfc(root_of(phase)) * conj(unit_phase(phase)));
  }
  return inside[0] * inside[1];
}

PanelReflection::Factor PanelReflection::factor(const Lanes& wavenumber) const {
  constexpr float third = 1.25992104989f;
  const ComplexLanes centre = pressure_factor(wavenumber);
  return {(norm(pressure_factor(wavenumber / third)) + norm(centre) + norm(pressure_factor(wavenumber * third))) / 3.f, argument(centre)};
}

namespace {

/// Of a sheet's own field at u^2 = k way from an edge: 0 at the edge, 1 far from it.
ComplexLanes past_edge(const WaveLanes& wave, double way_m) {
  const ComplexLanes rest = conj(wave.turn(way_m)) * scaled_erfc(wave.root * static_cast<float>(std::sqrt(way_m)));
  return ComplexLanes{all_lanes(1.f), {}} - rest;
}

/// The size of past_edge() without its ripple: what the other edges leave of an image.
Lanes past_edge_size(const WaveLanes& wave, double way_m) {
  return root_of(1.f - exp_of_negative(wave.number * static_cast<float>(-4.0 * std::numbers::inv_pi * way_m)));
}

/// Energy of a small sheet over Kirchhoff's, by (k low_ratio)^2 times the cosines: the limit, and a resonance.  Fitted to the exact strip.
Lanes small_panel(const Lanes& square) {
  const Lanes below = 1.f - 0.72f * square;
  return square * (1.f + square) / (below * below + 0.8f * square);
}

/// 1 for small panels, 0 for large ones: 1 / (1 + (k low_ratio / 1.3)^8).
Lanes smallness(const Lanes& low) {
  const Lanes x = low * (1.f / 1.3f), square = x * x, fourth = square * square;
  return 1.f / (1.f + fourth * fourth);
}

WaveLanes scaled(const WaveLanes& wave, double factor) {
  std::array<double, kLanes> wavenumber = wave.exact;
  for (double& k : wavenumber) k *= factor;
  return WaveLanes(wavenumber);
}

bool before_in_space(glm::dvec3 a, glm::dvec3 b) { return std::tie(a.x, a.y, a.z) < std::tie(b.x, b.y, b.z); }

}  // namespace

PanelWave::PanelWave(const PanelShape& panel, glm::dvec3 source, glm::dvec3 listener)
    : low_ratio_m_(panel.low_ratio_m), is_sheet_(panel.is_sheet) {
  if (before_in_space(listener, source)) std::swap(source, listener);
  const double source_height_m = glm::dot(source - panel.centre, panel.normal),
               listener_height_m = glm::dot(listener - panel.centre, panel.normal);
  const glm::dvec3 way = listener - (source - 2.0 * source_height_m * panel.normal);
  image_m_ = std::max(glm::length(way), double{kMinDistanceM});
  const glm::dvec3 reflection = listener - way * (listener_height_m / (source_height_m + listener_height_m));
  at_ = panel.nearest(reflection);
  in_sight_ = panel.holds(reflection);
  const glm::dvec3 unit = way / image_m_;
  for (std::size_t a = 0; a < 2; ++a) {
    const glm::dvec3 axis = panel.axis[a], other = panel.axis[1 - a];
    const double along_m = glm::dot(way, other), side_m = 2.0 * panel.half_side_m[a];
    const double sine = std::sqrt(std::max(1.0 - glm::dot(unit, other) * glm::dot(unit, other), 1e-6));
    Strip& strip = strips_[a];
    for (std::size_t end = 0; end < 2; ++end) {
      const double outward = end == 0 ? -1.0 : 1.0;
      const auto inward_m = [&](glm::dvec3 p) { return panel.half_side_m[a] - outward * glm::dot(p - panel.centre, axis); };
      const double a_source = inward_m(source), a_listener = inward_m(listener);
      const double r_source = std::hypot(a_source, source_height_m), r_listener = std::hypot(a_listener, listener_height_m);
      Edge& edge = strip.edge[end];
      const double over_edge_m = std::hypot(r_source + r_listener, along_m);
      edge.detour_m = std::max(over_edge_m - image_m_, 0.0);
      edge.spread = static_cast<float>(image_m_ / over_edge_m);
      edge.lit = inward_m(reflection) > 0;
      edge.past_source_m = std::max(sine * (side_m + std::hypot(a_source - side_m, source_height_m) - r_source), 0.0);
      edge.past_listener_m = std::max(sine * (side_m + std::hypot(a_listener - side_m, listener_height_m) - r_listener), 0.0);
      const double cosines = a_source * a_listener / (r_source * r_listener),
                   heights = source_height_m * listener_height_m / (r_source * r_listener);
      edge.root_of_length = static_cast<float>(std::sqrt(std::max(1.0 + cosines - heights, 0.0) * r_source * r_listener / over_edge_m));
      edge.factor = static_cast<float>(
          std::sqrt(2.0 * (1.0 + a_source / r_source) * (1.0 + a_listener / r_listener) / std::max(1.0 + heights + cosines, 1e-9)));
      strip.past_m[end] = std::max(side_m * (sine - outward * glm::dot(unit, axis)), 0.0);
    }
  }
  const glm::dvec3 to_source = glm::normalize(source - at_), to_listener = glm::normalize(listener - at_);
  const double heights = glm::dot(to_source, panel.normal) * glm::dot(to_listener, panel.normal);
  heights_ = static_cast<float>(heights);
  // 1 + c c' + t t', where t t' is what the directions have in common in the plane.
  low_factor_ = static_cast<float>(2.0 * heights / std::max(1.0 + glm::dot(to_source, to_listener), 1e-9));
}

PanelWave::Pressure PanelWave::pressure(const WaveLanes& wave) const {
  const ComplexLanes unit = {all_lanes(1.f), {}};
  Pressure product{unit, unit};
  for (const Strip& strip : strips_) {
    ComplexLanes image = unit;
    if (is_sheet_) image.real = past_edge_size(wave, strip.past_m[0]) * past_edge_size(wave, strip.past_m[1]);
    ComplexLanes whole = image, kirchhoff = unit;
    for (const Edge& edge : strip.edge) {
      const ComplexLanes erfc = scaled_erfc(wave.root * edge.root_of_length);
      const ComplexLanes part = all_lanes(0.5f * edge.spread) * (conj(wave.turn(edge.detour_m)) * erfc);
      kirchhoff = kirchhoff - (edge.lit ? part : unit - part);
      if (!is_sheet_) continue;
      // On the boundary of the image it has the image's size.
      const Lanes near = root_of(norm(erfc));
      ComplexLanes left = (1.f - near) * (past_edge(wave, edge.past_source_m) * past_edge(wave, edge.past_listener_m));
      left.real += near * past_edge_size(wave, edge.past_source_m) * past_edge_size(wave, edge.past_listener_m);
      const ComplexLanes own = all_lanes(edge.factor) * (part * left);
      whole = whole - (edge.lit ? own : image - own);
    }
    product.kirchhoff = product.kirchhoff * kirchhoff;
    product.whole = product.whole * (is_sheet_ ? whole : kirchhoff);
  }
  return product;
}

Lanes PanelWave::energy(const WaveLanes& wave, const Pressure& sum) const {
  if (!is_sheet_) return norm(sum.kirchhoff);
  const Lanes low = wave.number * static_cast<float>(low_ratio_m_), small = smallness(low);
  return small * low_factor_ * small_panel(low * low * heights_) * norm(sum.kirchhoff) + (1.f - small) * norm(sum.whole);
}

PanelReflection::Factor PanelWave::factor(const WaveLanes& wave) const {
  constexpr double third = 1.25992104989;
  const Pressure centre = pressure(wave);
  Lanes sum = energy(wave, centre);
  for (const WaveLanes& beside : {scaled(wave, 1.0 / third), scaled(wave, third)}) sum += energy(beside, pressure(beside));
  return {sum / 3.f, argument(centre.whole)};
}

Lanes smallness_of(const PanelShape& panel, const WaveLanes& wave) {
  return smallness(wave.number * static_cast<float>(panel.low_ratio_m));
}

double small_panel_gain(const PanelShape& panel, double wavenumber, double cosine) {
  if (!panel.is_sheet) return 1;
  const Lanes low = all_lanes(static_cast<float>(wavenumber * panel.low_ratio_m)), small = smallness(low);
  const Lanes gain = small * small_panel(low * low * static_cast<float>(cosine * cosine)) + (1.f - small);
  return double{gain[0]};
}

double reflected_fraction(const PanelShape& panel, double wavenumber, double cosine) {
  double fraction = small_panel_gain(panel, wavenumber, cosine);
  for (const double half_m : panel.half_side_m) {
    // (2 / pi) times the integral of (sin x / x)^2 from 0 to k half_side, within 10 %.
    const double x = wavenumber * half_m * 2.0 * std::numbers::inv_pi;
    fraction *= x / std::sqrt(1.0 + x * x);
  }
  return std::min(fraction, 1.0);
}

}  // namespace earshot
