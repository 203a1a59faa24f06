// SPDX-License-Identifier: Apache-2.0
#include "sim/acoustics/geometry/diffraction_edges.h"

#include <algorithm>
#include <array>
#include <atomic>
#include <cmath>
#include <numbers>
#include <utility>

#include "sim/acoustics/geometry/wedge_finder.h"
#include "sim/base/memory_bytes.h"

namespace earshot {
namespace {

constexpr double kDegree = std::numbers::pi / 180.0;

struct Found {
  double angle_rad;
  std::uint32_t material;
};

/// The widest sector of air about the edge at `along_m`, among the faces of the wedge and whatever rays meet between them on a circle of
/// `radius_m`.  False if none is wide enough.
bool narrow(const Scene& scene, DiffractionEdge& edge, double along_m, double radius_m) {
  constexpr double margin = 4.0 * kDegree, widest_step = 20.0 * kDegree;
  const int steps = static_cast<int>(std::ceil((edge.exterior_rad - 2.0 * margin) / widest_step));
  const double step = (edge.exterior_rad - 2.0 * margin) / steps;
  const auto point_at = [&](double angle) {
    return glm::vec3(edge.at(along_m) + radius_m * (std::cos(angle) * edge.face + std::sin(angle) * edge.first_normal));
  };
  std::array<Found, 20> face{};
  std::size_t count = 0;
  face[count++] = {0, edge.first_material};
  glm::vec3 from = point_at(margin);
  for (int i = 1; i <= steps; ++i) {
    const glm::vec3 to = point_at(margin + i * step);
    const float length_m = glm::length(to - from);
    const Hit hit = scene.rays().intersect(from, (to - from) / length_m, length_m);
    if (hit.valid()) {
      const double last_rad = face[count - 1].angle_rad;
      face[count++] = {std::clamp(edge.angle_of(glm::dvec3(hit.position)), last_rad, edge.exterior_rad),
                       scene.mesh().triangle_material[hit.triangle]};
    }
    from = to;
  }
  if (count == 1) return true;
  face[count++] = {edge.exterior_rad, edge.second_material};
  for (std::size_t i = 0; i + 1 < count; ++i) {
    const double sector = face[i + 1].angle_rad - face[i].angle_rad;
    if (sector < kMinExteriorRad) continue;
    const double turn = face[i].angle_rad;
    edge.face = std::cos(turn) * edge.face + std::sin(turn) * edge.first_normal;
    edge.first_normal = glm::cross(edge.along, edge.face);
    edge.exterior_rad = sector;
    edge.second_normal = glm::cross(edge.second_face(), edge.along);
    edge.first_material = face[i].material;
    edge.second_material = face[i + 1].material;
    return true;
  }
  return false;
}

/// How far from the middle of the edge one of its faces goes on.  Rays onto it from either side of its plane: faces that meet without
/// sharing vertices are one.
double width_of(const Scene& scene, const DiffractionEdge& edge, glm::dvec3 face, glm::dvec3 normal, double clearance_m) {
  const glm::dvec3 middle = edge.at(0.5 * edge.length_m);
  const auto is_there = [&](double width_m) {
    const double above_m = 2.0 * clearance_m + std::min(0.05 * width_m, 0.01);
    const Hit hit = scene.rays().intersect(glm::vec3(middle + width_m * face + above_m * normal), glm::vec3(-normal),
                                           static_cast<float>(2.0 * above_m));
    return hit.valid() && std::abs(glm::dot(glm::dvec3(hit.normal), normal)) > 0.99;
  };
  double width_m = 0.005;
  while (width_m < kWideFaceM && is_there(2.0 * width_m)) width_m *= 2.0;
  if (width_m >= kWideFaceM) return kWideFaceM;
  const double least_m = 0.12 * width_m;
  for (double more_m = 0.5 * width_m; more_m > least_m; more_m *= 0.5)
    if (is_there(width_m + more_m)) width_m += more_m;
  return width_m;
}

/// Two sheets that meet without sharing vertices both bring the wedge between them: keep the longer.
bool covers(const DiffractionEdge& longer, const DiffractionEdge& edge, double tolerance_m) {
  const double cosine = glm::dot(longer.along, edge.along);
  if (std::abs(cosine) < std::cos(1.0 * kDegree)) return false;
  if (std::abs(longer.exterior_rad - edge.exterior_rad) > 5.0 * kDegree) return false;
  if (glm::dot(longer.outward(), edge.outward()) < std::cos(5.0 * kDegree)) return false;
  const glm::dvec3 middle = edge.at(0.5 * edge.length_m) - longer.start;
  const double along_m = glm::dot(middle, longer.along);
  return along_m > 0 && along_m < longer.length_m && glm::length(middle - along_m * longer.along) < tolerance_m;
}

double diagonal_of(const Scene& scene) { return glm::length(glm::dvec3(scene.bounds().upper) - glm::dvec3(scene.bounds().lower)); }

/// Ten times the rounding of coordinates as large as the scene; far below anything that sound would notice.
double clearance_of(double diagonal_m) { return 2e-5 * diagonal_m; }

}  // namespace

double DiffractionEdge::angle_of(glm::dvec3 point) const {
  const glm::dvec3 from = point - start;
  double angle = std::atan2(glm::dot(from, first_normal), glm::dot(from, face));
  if (angle < 0) angle += 2.0 * std::numbers::pi;
  if (angle <= exterior_rad) return angle;
  return angle - exterior_rad < 0.5 * (2.0 * std::numbers::pi - exterior_rad) ? exterior_rad : 0.0;
}

glm::dvec3 DiffractionEdge::outward() const { return std::cos(0.5 * exterior_rad) * face + std::sin(0.5 * exterior_rad) * first_normal; }

glm::dvec3 DiffractionEdge::second_face() const { return std::cos(exterior_rad) * face + std::sin(exterior_rad) * first_normal; }

DiffractionEdges::DiffractionEdges(const Scene& scene, float least_length_m) : rays_(&scene.rays()) {
  if (scene.mesh().triangles.empty()) return;
  const double diagonal_m = diagonal_of(scene);
  clearance_m_ = clearance_of(diagonal_m);
  for (DiffractionEdge& wedge : find_wedges(scene.mesh(), least_length_m)) {
    const double radius_m = std::min(0.05 * wedge.length_m, 5e-4 * diagonal_m);
    // A beam may rest on a part of the edge: one free place is enough, rays decide about each path.
    bool open = false;
    for (const double fraction : {0.5, 0.19, 0.83}) {
      DiffractionEdge candidate = wedge;
      if (!narrow(scene, candidate, fraction * wedge.length_m, radius_m)) continue;
      wedge = candidate;
      open = true;
      break;
    }
    if (!open) continue;
    const bool known =
        std::any_of(edges_.begin(), edges_.end(), [&](const DiffractionEdge& longer) { return covers(longer, wedge, radius_m); });
    if (!known) edges_.push_back(wedge);
  }
  for (DiffractionEdge& edge : edges_) {
    outward_.push_back(edge.outward());
    edge.first_width_m = width_of(scene, edge, edge.face, edge.first_normal, clearance_m_);
    edge.second_width_m = width_of(scene, edge, edge.second_face(), edge.second_normal, clearance_m_);
  }
  sight_ = std::make_shared<const EdgeSight>(edges_.size());
}

DiffractionEdges::DiffractionEdges(const Scene& scene, std::vector<DiffractionEdge> known) : rays_(&scene.rays()) {
  if (scene.mesh().triangles.empty()) return;
  clearance_m_ = clearance_of(diagonal_of(scene));
  edges_ = std::move(known);
  for (const DiffractionEdge& edge : edges_) outward_.push_back(edge.outward());
  sight_ = std::make_shared<const EdgeSight>(edges_.size());
}

std::size_t DiffractionEdges::bytes() const { return bytes_of(edges_) + bytes_of(outward_) + (sight_ ? sight_->bytes() : 0); }

bool DiffractionEdges::visible_from(std::uint32_t edge, glm::vec3 point) const {
  if (!edges_[edge].in_air(glm::dvec3(point), clearance_m_)) return false;
  constexpr std::array<double, EdgeSight::kPointsPerEdge> fractions = {0.5, 0.2, 0.8, 0.02, 0.98};
  for (std::uint32_t i = 0; i < fractions.size(); ++i) {
    std::atomic<std::uint32_t>& remembered = sight_->blocker(edge, i, point);
    const std::uint32_t before = remembered.load(std::memory_order_relaxed);
    std::uint32_t blocker = before;
    if (!rays_->occluded(point, air_point(edge, fractions[i] * edges_[edge].length_m), blocker)) return true;
    if (blocker != before) remembered.store(blocker, std::memory_order_relaxed);
  }
  return false;
}

bool DiffractionEdges::mutually_visible(std::uint32_t edge, std::uint32_t other) const {
  if (const auto known = sight_->known(edge, other)) return *known;
  const bool visible = find_mutually_visible(edge, other);
  sight_->learn(edge, other, visible);
  return visible;
}

bool DiffractionEdges::find_mutually_visible(std::uint32_t edge, std::uint32_t other) const {
  constexpr std::array<std::array<double, 2>, 5> fractions = {{{0.5, 0.5}, {0.1, 0.1}, {0.9, 0.9}, {0.1, 0.9}, {0.9, 0.1}}};
  const DiffractionEdge &first_edge = edges_[edge], &second_edge = edges_[other];
  for (const auto& fraction : fractions) {
    const double here_m = fraction[0] * first_edge.length_m, there_m = fraction[1] * second_edge.length_m;
    const glm::dvec3 from = first_edge.at(here_m), to = second_edge.at(there_m);
    if (!first_edge.in_air(to, clearance_m_) || !second_edge.in_air(from, clearance_m_)) continue;
    if (!rays_->occluded(air_point(edge, here_m), air_point(other, there_m))) return true;
  }
  return false;
}

}  // namespace earshot
