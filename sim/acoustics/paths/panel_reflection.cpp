// SPDX-License-Identifier: Apache-2.0
#include "sim/acoustics/paths/panel_reflection.h"

#include <algorithm>
#include <cmath>
#include <glm/geometric.hpp>
#include <limits>
#include <numbers>

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

double boundary_weight(double waves) {
  const double x = 4.0 * waves - 1.0;
  return x <= 0 ? 1.0 : x >= 1 ? 0.0 : 0.5 + 0.5 * std::cos(std::numbers::pi * x);
}

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

}  // namespace earshot
