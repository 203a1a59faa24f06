// SPDX-License-Identifier: Apache-2.0
#include "sim/rays/hit_surface.h"

#include <array>
#include <cmath>
#include <cstddef>
#include <glm/common.hpp>

namespace earshot {
namespace {

/// The point with these weights of the corners, moved across each edge that it lies closer to than `margin_m`.  By no more than a few
/// margins, and never past the middle of what is left: in a needle, which is narrower than that, a point stays where it is.
glm::vec3 weighted_off_edges(const std::array<glm::dvec3, 3>& corners, std::array<double, 3> weights, double margin_m) {
  double sum = 0;
  for (double& weight : weights) sum += weight = std::max(weight, 0.0);
  for (double& weight : weights) weight /= sum;
  for (std::size_t i = 0; i < 3; ++i) {
    const std::size_t j = (i + 1) % 3, k = (i + 2) % 3;
    const glm::dvec3 edge = corners[k] - corners[j], side = corners[i] - corners[j];
    const double edge2 = glm::dot(edge, edge), area = glm::length(glm::cross(edge, side));
    if (!(area > 0)) break;
    const double wanted = margin_m * std::sqrt(edge2) / area;  // weight at that distance from the edge opposite corner i
    double missing = wanted - weights[i];
    if (!(missing > 0)) continue;
    // At right angles to the edge: the foot of the height decides how much each of the others loses.
    const double weight_k = glm::dot(side, edge) / edge2, weight_j = 1 - weight_k;
    double straight = missing;
    if (weight_j > 0) straight = std::min(straight, 0.5 * weights[j] / weight_j);
    if (weight_k > 0) straight = std::min(straight, 0.5 * weights[k] / weight_k);
    weights[i] += straight;
    weights[j] -= straight * weight_j;
    weights[k] -= straight * weight_k;
    // In a corner one of them is zero already: the rest moves along the side to the other one.
    missing -= straight;
    const std::size_t donor = weights[j] > weights[k] ? j : k;
    const double along = std::min({missing, 0.5 * weights[donor], 4 * margin_m / glm::length(corners[i] - corners[donor])});
    weights[i] += along;
    weights[donor] -= along;
  }
  return weights[0] * corners[0] + weights[1] * corners[1] + weights[2] * corners[2];
}

}  // namespace

HitSurface hit_surface_of(glm::vec3 a, glm::vec3 b, glm::vec3 c) {
  constexpr float roundings = 4 * 0x1p-23f;
  const glm::vec3 far = glm::max(glm::max(glm::abs(a), glm::abs(b)), glm::abs(c));
  HitSurface surface{.a = a, .b = b, .c = c, .margin_m = roundings * std::max({far.x, far.y, far.z})};
  const glm::dvec3 ab = glm::dvec3(b) - glm::dvec3(a), ac = glm::dvec3(c) - glm::dvec3(a);
  const glm::dvec3 n = glm::cross(ab, ac);  // double: a needle of 1e-7 m still has a direction
  const double length = glm::length(n), longest = std::max({glm::length(ab), glm::length(ac), glm::length(ac - ab)});
  if (!(length > 0 && std::isfinite(length))) return surface;
  surface.normal = n / length;
  surface.inverse_height = static_cast<float>(std::min(longest / length, 1e30));
  return surface;
}

glm::vec3 point_off_edges(const HitSurface& surface, float u, float v) {
  const float w = 1.f - u - v;
  return weighted_off_edges({surface.a, surface.b, surface.c}, {w, u, v}, surface.margin_m);
}

}  // namespace earshot
