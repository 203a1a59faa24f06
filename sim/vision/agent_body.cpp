// SPDX-License-Identifier: Apache-2.0
#include "sim/vision/agent_body.h"

#include <algorithm>
#include <cmath>
#include <glm/geometric.hpp>

#include "sim/scene/appearance.h"

namespace earshot {
namespace {

constexpr double kNever = std::numeric_limits<double>::infinity();

}  // namespace

/// A cylinder is the common part of an endless one and of the slab between its caps: the ray is in it where it is in both.
BodyHit intersect(const AgentBody& body, glm::vec3 origin, glm::vec3 direction) {
  const glm::dvec3 from = glm::dvec3(origin) - glm::dvec3(body.foot), along(direction);
  const double radius_m = body.radius_m, height_m = body.height_m;
  double side_in = -kNever, side_out = kNever, caps_in = -kNever, caps_out = kNever;
  const double a = along.x * along.x + along.z * along.z, c = from.x * from.x + from.z * from.z - radius_m * radius_m;
  if (a > 0) {
    const double b = from.x * along.x + from.z * along.z, discriminant = b * b - a * c;
    if (!(discriminant > 0)) return {};
    const double root = std::sqrt(discriminant);
    side_in = (-b - root) / a;
    side_out = (-b + root) / a;
  } else if (c > 0) {
    return {};
  }
  if (along.y != 0) {
    caps_in = std::min(-from.y / along.y, (height_m - from.y) / along.y);
    caps_out = std::max(-from.y / along.y, (height_m - from.y) / along.y);
  } else if (from.y < 0 || from.y > height_m) {
    return {};
  }
  const double in = std::max(side_in, caps_in), out = std::min(side_out, caps_out);
  if (!(in < out) || !(out > 0)) return {};
  const double distance_m = in > 0 ? in : out;
  const bool on_side = in > 0 ? side_in >= caps_in : side_out <= caps_out;
  const glm::dvec3 at = from + distance_m * along;
  glm::dvec3 normal = on_side ? glm::normalize(glm::dvec3(at.x, 0, at.z)) : glm::dvec3(0, 1, 0);
  if (glm::dot(normal, along) > 0) normal = -normal;
  return {static_cast<float>(distance_m), glm::vec3(normal)};
}

glm::vec3 body_color(int agent) {
  constexpr double kGoldenTurn = 0.6180339887498949, kSaturation = 0.8, kValue = 0.9;
  const double hue = 6.0 * std::fmod(agent * kGoldenTurn, 1.0);
  const auto channel = [&](double offset) {
    const double distance = std::abs(std::remainder(hue - offset, 6.0));  // from the channel's own hue, in [0, 3]
    return static_cast<float>(kValue * (1.0 - kSaturation * std::clamp(distance - 1.0, 0.0, 1.0)));
  };
  return {channel(0), channel(2), channel(4)};
}

std::uint16_t agent_category() { return static_cast<std::uint16_t>(category_names().size() - 1); }

}  // namespace earshot
