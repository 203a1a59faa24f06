// SPDX-License-Identifier: Apache-2.0
#include "sim/scene/habitat/placement.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <glm/common.hpp>
#include <glm/geometric.hpp>
#include <glm/gtc/matrix_transform.hpp>
#include <limits>

#include "sim/base/coordinates.h"
#include "sim/base/text/text_match.h"

namespace earshot {
namespace {

constexpr double kSmallestScale = 1e-6, kLargestScale = 1e6;
/// Directions and scales of data sets are written with the digits of floats.
constexpr double kTolerance = 1e-4;

glm::dvec3 direction(const JsonFields& fields, const char* key) {
  const glm::dvec3 vector = *fields.vector(key, kLargestScale);
  const double length = glm::length(vector);
  if (!(length > kSmallestScale)) fields.fail(key, "has no direction", "write a vector such as [0, 1, 0]");
  return vector / length;
}

bool is_unit(glm::dmat3 frame) {
  return glm::length(frame[0] - glm::dvec3(1, 0, 0)) < kTolerance && glm::length(frame[1] - glm::dvec3(0, 1, 0)) < kTolerance;
}

void check_scale(glm::dvec3 scale, const JsonFields& fields, const char* key) {
  for (int axis = 0; axis < 3; ++axis)
    if (!(std::fabs(scale[axis]) >= kSmallestScale && std::fabs(scale[axis]) <= kLargestScale))
      fields.fail(key, fmt::format("gives the scale {:g}", scale[axis]),
                  fmt::format("its size must be from {:g} to {:g}", kSmallestScale, kLargestScale));
}

/// An axis may have another scale only where the asset is not turned: the order of both has no public description.
void check_order(const Placement& placement, const JsonFields& fields, const char* key) {
  const glm::dvec3 scale = placement.scale;
  const double largest = std::max({std::fabs(scale.x - scale.y), std::fabs(scale.y - scale.z), std::fabs(scale.z - scale.x)});
  if (largest > kTolerance * std::fabs(scale.x) && !is_unit(placement.frame))
    fields.fail(key, "differs by axis for an asset with another `up` or `front`, of which the order has no public description",
                "turn the mesh to y up and -z in front");
}

}  // namespace

Placement frame_of(const Attributes& attributes) {
  Placement placement;
  const JsonFields *up = attributes.with("up"), *front = attributes.with("front");
  if ((up == nullptr) != (front == nullptr))
    (up ? up : front)->fail(up ? "up" : "front", "is alone", "give both `up` and `front`, at right angles");
  if (up) {
    const glm::dvec3 y = direction(*up, "up"), z = -direction(*front, "front");
    if (std::fabs(glm::dot(y, z)) > kTolerance) up->fail("up", "is not at right angles to `front`", "correct one of them");
    placement.frame = glm::transpose(glm::dmat3(glm::cross(y, z), y, z));
  }
  if (const JsonFields* origin = attributes.with("origin"); origin && *origin->vector("origin", kMaxCoordinateM) != glm::dvec3(0))
    origin->fail("origin", "is not zero, and its effect has no public description", "use the translation of the stage instance");
  if (const JsonFields* scale = attributes.with("scale")) {
    placement.scale = *scale->vector("scale", kLargestScale);
    check_scale(placement.scale, *scale, "scale");
    check_order(placement, *scale, "scale");
  }
  if (const JsonFields* unit = attributes.with("units_to_meters"))
    placement.scale *= *unit->number("units_to_meters", kSmallestScale, kLargestScale);
  return placement;
}

Placement place(Placement placed, const JsonFields& instance) {
  placed.translation = instance.vector("translation", kMaxCoordinateM).value_or(glm::dvec3(0));
  placed.rotation = instance.rotation("rotation").value_or(glm::dquat(1, 0, 0, 0));
  placed.scale *= instance.number("uniform_scale", -kLargestScale, kLargestScale).value_or(1);
  check_scale(placed.scale, instance, "uniform_scale");
  placed.scale *= instance.vector("non_uniform_scale", kLargestScale).value_or(glm::dvec3(1));
  check_scale(placed.scale, instance, "non_uniform_scale");
  check_order(placed, instance, "non_uniform_scale");
  return placed;
}

Placement place_by_mass(Placement placed, const Attributes& attributes, const JsonFields& instance, const JsonFields& scene) {
  const JsonFields& deciding = instance.has("translation_origin") ? instance : scene;
  const std::string origin = fold_case(deciding.text("translation_origin").value_or("com"));
  if (origin != "com" && origin != "asset_local")
    deciding.fail("translation_origin", "is neither COM nor asset_local", "write one of them");
  if (origin == "asset_local") return placed;
  const JsonFields* mass = attributes.with("COM");
  placed.is_centered_on_box = mass == nullptr;
  if (!mass) return placed;
  placed.center = *mass->vector("COM", kMaxCoordinateM);
  const bool is_plain = is_unit(placed.frame) && glm::length(placed.scale - glm::dvec3(1)) < kTolerance;
  if (placed.center != glm::dvec3(0) && !is_plain)
    mass->fail("COM", "is not zero for an asset with a scale, `up` or `front`, of which the order has no public description",
               "write translation_origin: asset_local");
  return placed;
}

glm::dmat4 matrix_of(const Placement& placement, const TriangleMesh& mesh) {
  const glm::dmat3 scaled =
      glm::dmat3(glm::dvec3(placement.scale.x, 0, 0), glm::dvec3(0, placement.scale.y, 0), glm::dvec3(0, 0, placement.scale.z)) *
      placement.frame;
  glm::dvec3 center = placement.center;
  if (placement.is_centered_on_box) {
    constexpr double infinity = std::numeric_limits<double>::infinity();
    glm::dvec3 lower(infinity), upper(-infinity);
    for (const glm::vec3 vertex : mesh.vertices) {
      const glm::dvec3 p = scaled * (glm::dvec3(vertex) + mesh.origin_m);
      lower = glm::min(lower, p);
      upper = glm::max(upper, p);
    }
    if (!mesh.vertices.empty()) center = 0.5 * (lower + upper);
  }
  const glm::dmat3 rotation = glm::mat3_cast(placement.rotation);
  glm::dmat4 matrix(rotation * scaled);
  matrix[3] = glm::dvec4(placement.translation - rotation * center, 1);
  return matrix;
}

}  // namespace earshot
