#include "sim/acoustics/paths/panel_reflection.h"

#include <algorithm>
#include <cmath>
#include <complex>
#include <glm/geometric.hpp>
#include <limits>
#include <numbers>

#include "sim/acoustics/paths/fast_angles.h"
#include "sim/acoustics/paths/utd.h"

namespace earshot {
namespace {

constexpr double kPi = std::numbers::pi;

/// How much longer the shortest way from a to b over the edge's line is than the straight one.
double detour(const PanelEdge& edge, glm::dvec3 a, glm::dvec3 b, double straight_m) {
  const glm::dvec3 from_a = a - edge.start, from_b = b - edge.start;
  const double along_a = glm::dot(from_a, edge.along), along_b = glm::dot(from_b, edge.along);
  const double away = glm::length(from_a - along_a * edge.along) + glm::length(from_b - along_b * edge.along);
  return std::max(std::sqrt(away * away + (along_a - along_b) * (along_a - along_b)) - straight_m, 0.0);
}

}  // namespace

double boundary_weight(double waves) {
  const double x = std::clamp(4.0 * waves - 1.0, 0.0, 1.0);
  return 0.5 + 0.5 * std::cos(kPi * x);
}

PanelReflection::PanelReflection(std::span<const PanelEdge> edges, glm::dvec3 image, glm::dvec3 listener, glm::dvec3 at,
                                 double longest_wave_m) {
  constexpr double endless = std::numeric_limits<double>::infinity();
  detour_m_.fill(endless);
  // The nearest edge beside the point gives the directions; the others count for the one that they face most.
  double nearest_m = endless;
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
  if (nearest_m == endless) return;
  const double straight_m = glm::length(listener - image);
  std::array<double, 4> closest_m;
  closest_m.fill(endless);
  for (const PanelEdge& edge : edges) {
    if (!beside(edge, distance_m)) continue;
    const double along_axis = glm::dot(edge.outward, axis), along_across = glm::dot(edge.outward, across);
    const bool first = std::abs(along_axis) >= std::abs(along_across);
    const std::size_t side = first ? (along_axis > 0 ? 0 : 1) : (along_across > 0 ? 2 : 3);
    if (distance_m >= closest_m[side]) continue;
    closest_m[side] = distance_m;
    const double detour_m = detour(edge, image, listener, straight_m);
    detour_m_[side] = detour_m < 1.26 * longest_wave_m ? detour_m : endless;
    finite_ = finite_ || detour_m_[side] < endless;
  }
}

std::complex<double> PanelReflection::pressure_factor(double wavenumber) const {
  std::array<std::complex<double>, 2> inside = {1.0, 1.0};
  for (std::size_t side = 0; side < 4; ++side) {
    const double phase = wavenumber * detour_m_[side];
    if (!(phase < 2.0 * kPi)) continue;
    // The Fresnel integral past the edge, over the whole: half of exp(-j u^2) scaled_erfc(u), u^2 = k detour.
    inside[side / 2] -= boundary_weight(phase / (4.0 * kPi)) * 0.5 * scaled_erfc(std::sqrt(phase)) * std::conj(fast_unit_phase(phase));
  }
  return inside[0] * inside[1];
}

PanelReflection::Factor PanelReflection::factor(double wavenumber) const {
  constexpr double third = 1.25992104989;
  if (wavenumber / third * *std::min_element(detour_m_.begin(), detour_m_.end()) >= 2.0 * kPi) return {};
  const std::complex<double> centre = pressure_factor(wavenumber);
  return {(std::norm(pressure_factor(wavenumber / third)) + std::norm(centre) + std::norm(pressure_factor(wavenumber * third))) / 3.0,
          std::arg(centre)};
}

}  // namespace earshot
