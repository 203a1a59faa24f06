// SPDX-License-Identifier: Apache-2.0
#include "sim/acoustics/paths/mirror_chains.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <glm/geometric.hpp>
#include <optional>
#include <queue>
#include <span>

#include "sim/acoustics/core/sampling.h"
#include "sim/acoustics/geometry/convex_polygon.h"
#include "sim/acoustics/paths/image_deposit.h"
#include "sim/acoustics/paths/mirror_decay.h"

namespace earshot {
namespace {

constexpr double kMinCosine = 0.866;          // of the angle between planes that face each other
constexpr double kSpentChain = 1e-6;          // of energy, after which a chain ends
constexpr std::size_t kMaxWaiting = 200'000;  // beams, for the sake of memory

glm::dvec3 middle_of(const ConvexPolygon& polygon) {
  glm::dvec3 sum(0);
  for (const glm::dvec3 vertex : polygon) sum += vertex;
  return sum / static_cast<double>(polygon.size());
}

/// Does the source stand between two planes whose chains outlast the diffuse field?
bool has_protruding_pair(const AcousticScene& scene, std::span<const ConvexPolygon> polygons, glm::vec3 source) {
  std::optional<DiffuseDecay> decay;  // of the first pair that needs it
  for (std::size_t i = 0; i < polygons.size(); ++i) {
    const ExactPlane first(scene.planes()[i]);
    for (std::size_t j = 0; j < i; ++j) {
      const ExactPlane second(scene.planes()[j]);
      if (polygons[i].empty() || polygons[j].empty() || std::abs(glm::dot(first.normal, second.normal)) < kMinCosine) continue;
      if (glm::length(glm::cross(first.normal, second.normal)) <= FacingPlanes::kParallelSine) continue;
      const double forward_height = first.height(middle_of(polygons[j])), backward_height = second.height(middle_of(polygons[i]));
      if (!(forward_height * first.height(glm::dvec3(source)) > 0 && backward_height * second.height(glm::dvec3(source)) > 0)) continue;
      const double gap_m = 0.5 * (std::abs(forward_height) + std::abs(backward_height));
      if (gap_m < 1e-3 * scene.diagonal_m()) continue;
      if (!decay) decay.emplace(scene, source);
      if (decay->exceeded_by(scene.planes()[i].material, scene.planes()[j].material, gap_m)) return true;
    }
  }
  return false;
}

/// A reflection that may be part of chains, waiting to be followed.
struct Beam {
  double strength;
  std::uint64_t number;  // in the order of birth, which decides among equals
  std::uint32_t parent, plane;
  int order;
  glm::dvec3 image;
  ConvexPolygon aperture;  // the part of the plane that it lights
  std::array<double, kMaxBands> kept;
  MirrorChains::Chain chain;
  FacingPlanes::Chain facing;
  bool operator<(const Beam& other) const { return strength != other.strength ? strength < other.strength : number > other.number; }
};

/// A plane that reflects beams.
struct BeamMirror {
  ExactPlane plane;
  ConvexPolygon polygon;
  std::array<double, kMaxBands> specular;  ///< energy fraction, the largest over all angles
  std::uint32_t material;
};

/// The beams of one source, strongest first.
class BeamQueue {
 public:
  BeamQueue(const AcousticScene& scene, const FacingPlanes& facing, std::span<const BeamMirror> mirrors)
      : scene_(scene), facing_(facing), mirrors_(mirrors) {}

  [[nodiscard]] bool empty() const { return waiting_.empty(); }
  Beam pop() {
    Beam beam = waiting_.top();
    waiting_.pop();
    return beam;
  }
  /// Reflects the beam of `image` behind `from` (null: of the source itself) in plane p, as a child of `node`.
  void reflect(const Beam* from, std::uint32_t node, glm::dvec3 image, std::uint32_t p) {
    Beam beam{};
    double strongest = set_kept_energy(from, p, beam);
    if (strongest < kSpentChain || waiting_.size() >= kMaxWaiting) return;
    const ExactPlane& plane = mirrors_[p].plane;
    if (std::abs(plane.height(image)) < 1e-6 * scene_.diagonal_m()) return;
    clip_aperture(from, image, p, beam);
    if (beam.aperture.empty()) return;
    if (scene_.surfaces().reacts_locally(mirrors_[p].material)) strongest = limit_by_angle(from, image, p, beam);
    if (strongest < kSpentChain) return;
    const double length_m = glm::length(middle_of(beam.aperture) - image);
    if (std::abs(plane.height(image)) > double{scene_.max_path_m()} || !(length_m > 0)) return;
    beam.strength = strongest / (length_m * length_m);
    beam.number = num_pushed_++;
    beam.parent = node, beam.plane = p, beam.order = (from ? from->order : 0) + 1;
    beam.image = plane.mirror(image);
    if (from) beam.chain = from->chain, beam.facing = from->facing;
    MirrorChains::extend(beam.chain, p);
    facing_.extend(beam.facing, p);
    waiting_.push(std::move(beam));
  }

 private:
  /// The energy that is left after plane p.  Returns that of the strongest band.
  double set_kept_energy(const Beam* from, std::uint32_t p, Beam& beam) const {
    double strongest = 0;
    for (int b = 0; b < scene_.num_bands(); ++b) {
      const auto i = static_cast<std::size_t>(b);
      beam.kept[i] = (from ? from->kept[i] : 1.0) * mirrors_[p].specular[i];
      strongest = std::max(strongest, beam.kept[i]);
    }
    return strongest;
  }
  /// The same with the largest reflection over the angles at which the aperture is lit.  |R|^2 falls from grazing incidence to one minimum
  /// and rises again (wall_impedance.h): the largest is at the most oblique angle, that of a corner of the aperture, or at normal
  /// incidence.
  double limit_by_angle(const Beam* from, glm::dvec3 image, std::uint32_t p, Beam& beam) const {
    double furthest_m = 0;
    for (const glm::dvec3 corner : beam.aperture) furthest_m = std::max(furthest_m, glm::length(corner - image));
    const double least_cosine = std::min(std::abs(mirrors_[p].plane.height(image)) / furthest_m, 1.0);
    double strongest = 0;
    for (int b = 0; b < scene_.num_bands(); ++b) {
      const auto i = static_cast<std::size_t>(b);
      beam.kept[i] = (from ? from->kept[i] : 1.0) * std::max(specular_fraction(scene_, mirrors_[p].material, b, least_cosine),
                                                             specular_fraction(scene_, mirrors_[p].material, b, 1.0));
      strongest = std::max(strongest, beam.kept[i]);
    }
    return strongest;
  }
  /// The part of plane p on the side of the last plane on which the image is not, and in its light.
  void clip_aperture(const Beam* from, glm::dvec3 image, std::uint32_t p, Beam& beam) const {
    beam.aperture = mirrors_[p].polygon;
    if (!from) return;
    const ExactPlane& last = mirrors_[from->plane].plane;
    const double side = last.height(image) > 0 ? -1.0 : 1.0;
    beam.aperture = lit_part(clipped(beam.aperture, side * last.normal, side * last.offset_m), image, from->aperture);
  }

  const AcousticScene& scene_;
  const FacingPlanes& facing_;
  std::span<const BeamMirror> mirrors_;
  std::priority_queue<Beam> waiting_;
  std::uint64_t num_pushed_ = 0;
};

}  // namespace

MirrorChains::MirrorChains(const AcousticScene& scene, const SoundSource& source, const FacingPlanes& facing)
    : source_(source), emission_(source, scene.bands()) {
  if (scene.image_order() == 0) return;  // without image paths mirrors are the tracers' alone
  grow(scene, facing, scene.config().rays < FacingPlanes::kManyRays ? kFewChains : kMaxChains);
}

void MirrorChains::grow(const AcousticScene& scene, const FacingPlanes& facing, std::size_t most) {
  const std::size_t num_planes = std::min(scene.planes().size(), FacingPlanes::kMaxPlanes);
  std::vector<ConvexPolygon> polygons;
  for (std::size_t p = 0; p < num_planes; ++p) polygons.push_back(polygon_of(scene.planes()[p]));
  if (!has_protruding_pair(scene, polygons, source_.position)) return;
  std::vector<BeamMirror> beam_mirrors;
  for (std::size_t p = 0; p < num_planes; ++p) {
    const ExactPlane plane(scene.planes()[p]);
    mirrors_.push_back({plane, scene.planes()[p]});
    BeamMirror& mirror = beam_mirrors.emplace_back(BeamMirror{plane, polygons[p], {}, scene.planes()[p].material});
    for (int b = 0; b < scene.num_bands(); ++b)
      mirror.specular[static_cast<std::size_t>(b)] = largest_specular_fraction(scene, mirrors_[p].rounded.material, b);
  }

  BeamQueue beams(scene, facing, beam_mirrors);
  for (std::uint32_t p = 0; p < num_planes; ++p) beams.reflect(nullptr, kSource, glm::dvec3(source_.position), p);
  while (!beams.empty() && chains_.size() < most) {
    const Beam beam = beams.pop();
    const auto node = static_cast<std::uint32_t>(nodes_.size());
    nodes_.push_back({beam.image, beam.parent, beam.plane});
    if (beam.order > scene.image_order() && !facing.carries(beam.facing)) {
      chains_.push_back(node);
      keys_.push_back(beam.chain.from_source);
    }
    for (std::uint32_t p = 0; p < num_planes; ++p)
      if (p != beam.plane) beams.reflect(&beam, node, beam.image, p);
  }
  std::sort(keys_.begin(), keys_.end());
  keys_.erase(std::unique(keys_.begin(), keys_.end()), keys_.end());
}

bool MirrorChains::carries(std::uint64_t key) const { return std::binary_search(keys_.begin(), keys_.end(), key); }

std::vector<std::uint32_t> MirrorChains::rule() const {
  std::uint64_t sum = 0;
  for (const std::uint64_t key : keys_) sum += key;
  return {static_cast<std::uint32_t>(sum), static_cast<std::uint32_t>(sum >> 32)};
}

bool MirrorChains::find_path(const AcousticScene& scene, std::uint32_t chain, glm::vec3 listener, std::span<double> kept,
                             glm::dvec3& departure) const {
  // Where the straight lines to the images meet the planes; `at` is moved there.
  const auto step = [&](const Node& node, glm::dvec3& at) {
    const Mirror& mirror = mirrors_[node.plane];
    const double point_height = mirror.plane.height(at), image_height = mirror.plane.height(node.image);
    if (!(point_height * image_height < 0)) return false;
    at += point_height / (point_height - image_height) * (node.image - at);
    return mirror.rounded.bounds_hold(at);
  };
  glm::dvec3 at(listener);
  for (std::uint32_t n = chain; n != kSource; n = nodes_[n].parent)
    if (!step(nodes_[n], at)) return false;
  departure = glm::normalize(at - glm::dvec3(source_.position));

  // Then rays: the first thing that each segment meets is a triangle of its plane.
  const EmbreeScene& rays = scene.scene().rays();
  glm::vec3 origin = listener;
  at = glm::dvec3(listener);
  for (std::uint32_t n = chain; n != kSource; n = nodes_[n].parent) {
    step(nodes_[n], at);
    const glm::dvec3 direction = glm::normalize(at - glm::dvec3(origin));
    const Hit hit = rays.intersect(origin, glm::vec3(direction));
    if (!hit.valid() || scene.plane_of_triangle()[hit.triangle] != nodes_[n].plane) return false;
    const std::uint32_t material = scene.scene().mesh().triangle_material[hit.triangle];
    const double cosine = std::abs(glm::dot(direction, glm::dvec3(hit.normal)));
    for (int b = 0; b < scene.num_bands(); ++b) kept[static_cast<std::size_t>(b)] *= specular_fraction(scene, material, b, cosine);
    origin = offset_from_surface(hit.position, hit.normal);
  }
  return !rays.occluded(origin, source_.position);
}

void MirrorChains::add_late(const AcousticScene& scene, glm::vec3 listener, EnergyHistogram& histogram) const {
  ImageDeposit deposit(scene, emission_, histogram);
  std::array<double, kMaxBands> kept;
  for (const std::uint32_t chain : chains_) {
    const glm::dvec3 toward = nodes_[chain].image - glm::dvec3(listener);
    const double distance_m = glm::length(toward);
    if (distance_m > double{scene.max_path_m()}) continue;
    kept.fill(1.0);
    glm::dvec3 departure;
    if (find_path(scene, chain, listener, kept, departure)) deposit.add(kept, distance_m, toward / distance_m, departure);
  }
}

}  // namespace earshot
