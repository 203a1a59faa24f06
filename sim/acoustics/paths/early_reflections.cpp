// SPDX-License-Identifier: Apache-2.0
#include "sim/acoustics/paths/early_reflections.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <glm/geometric.hpp>
#include <numbers>

#include "sim/acoustics/core/sampling.h"
#include "sim/acoustics/geometry/exact_plane.h"
#include "sim/acoustics/model/diffraction_budget.h"
#include "sim/acoustics/paths/line_of_sight.h"
#include "sim/acoustics/paths/panel_reflection.h"
#include "sim/acoustics/paths/path_level.h"
#include "sim/base/coordinates.h"
#include "sim/base/denormals.h"
#include "sim/base/errors.h"
#include "sim/base/random.h"

namespace earshot {
namespace {

/// Its position, if it is one.
glm::vec3 checked_position(const SoundSource& source) {
  const glm::vec3 p = source.position;
  if (!is_valid_position(p))
    throw InputError(fmt::format("source ({}, {}, {})", p.x, p.y, p.z), "is not a valid position in a scene",
                     "give three finite numbers in metres");
  require(source.radius_m >= 0.f && source.radius_m <= 100.f, "radius of the source", source.radius_m, "must be in [0, 100] m");
  return p;
}

constexpr double kMaxSequencesPerOrder = 2048;  // of the exhaustive search
constexpr double kSlackM = 1e-6;                // of culling
constexpr int kOwnRays = 8;                     // of a source that moves: one in so many

/// A mirror plane, or from planes().size() on a fold.
const MirrorPlane& mirror_at(const AcousticScene& scene, std::uint32_t plane) {
  const std::size_t count = scene.planes().size();
  return plane < count ? scene.planes()[plane] : scene.folds().planes[plane - count];
}

bool same_path(const Arrival& a, const Arrival& b) {
  constexpr float tolerance = 1e-4f;
  return a.order == b.order && std::fabs(a.distance_m - b.distance_m) <= tolerance * a.distance_m &&
         glm::dot(a.direction - b.direction, a.direction - b.direction) <= tolerance * tolerance;
}

/// Few planes: every sequence in which no plane follows itself, order by order.  Returns whether rays find no others.
bool append_all_sequences(int order, std::uint32_t num_planes, std::vector<PlaneSequence>& sequences) {
  std::vector<PlaneSequence> last = {{}};
  bool all_known = false;
  for (int n = 1; n <= order; ++n) {
    if (static_cast<double>(last.size()) * num_planes > kMaxSequencesPerOrder) break;
    std::vector<PlaneSequence> longer;
    for (const PlaneSequence& prefix : last) {
      for (std::uint32_t plane = 0; plane < num_planes; ++plane) {
        if (n > 1 && prefix.plane[n - 2] == plane) continue;
        PlaneSequence& sequence = longer.emplace_back(prefix);
        sequence.plane[n - 1] = plane;
        sequence.order = n;
      }
    }
    sequences.insert(sequences.end(), longer.begin(), longer.end());
    last = std::move(longer);
    all_known = n == order;
  }
  return all_known;
}

/// Many planes: those that specular rays from the source meet, whatever their fraction of energy.
void append_met_sequences(const AcousticScene& scene, glm::vec3 source, SourceMotion motion, std::vector<PlaneSequence>& sequences) {
  const AcousticConfig& config = scene.config();
  const auto shift = RandomStream(config.seed, Purpose::source_ray).bits4(0);
  const SphereSequence directions(shift[0], shift[1]);
  const bool moves = motion == SourceMotion::moves;
  const int rays = moves ? (config.early_candidate_rays + kOwnRays - 1) / kOwnRays : config.early_candidate_rays;
  for (int ray = 0; ray < rays; ++ray) append_sequences(scene, source, directions.direction(static_cast<std::uint32_t>(ray)), sequences);
  if (!moves) return;
  const auto of_cell = scene.plane_cells().of(scene, source);
  sequences.insert(sequences.end(), of_cell->begin(), of_cell->end());
}

/// A path by mirrors from a listener back to the source.
struct MirrorPath {
  static constexpr std::size_t kMaxOrder = PlaneSequence::kMaxOrder;
  explicit MirrorPath(const PlaneSequence& planes_met) : sequence(planes_met) {}
  const PlaneSequence& sequence;
  std::array<glm::dvec3, kMaxOrder> point;                       ///< of reflection, by the order from the source
  std::array<std::uint32_t, kMaxOrder> met_plane{}, met_fold{};  ///< of the triangles there
  std::array<double, kMaxOrder> cosine{};                        ///< of the angle of incidence
  std::array<double, kMaxBands> energy_fraction;                 ///< that the reflections keep
  std::array<double, kMaxBands> phase_rad{};                     ///< of locally reacting walls
  [[nodiscard]] std::size_t order() const { return static_cast<std::size_t>(sequence.order); }
  [[nodiscard]] std::span<const std::uint32_t> planes() const { return std::span(sequence.plane).first(order()); }
};

/// Points of reflection, from the listener back to the source: each segment must cross its plane between its ends, where the plane has
/// triangles.
bool find_reflection_points(const AcousticScene& scene, glm::dvec3 image, glm::dvec3 listener, MirrorPath& path) {
  const PlaneSequence& sequence = path.sequence;
  glm::dvec3 start = listener;
  const double edge_m = 1e-6 * scene.diagonal_m();  // a path through the edge of two planes meets both at one point
  for (int i = sequence.order - 1; i >= 0; --i) {
    const MirrorPlane& rounded = mirror_at(scene, sequence.plane[i]);
    const ExactPlane plane(rounded);
    const double start_height = plane.height(start), image_height = plane.height(image);
    path.cosine[i] = std::abs(start_height - image_height) / glm::length(image - start);
    const bool at_edge = i + 1 < sequence.order && std::abs(start_height) < edge_m;
    if (!at_edge && !(start_height * image_height < 0)) return false;
    path.point[i] = at_edge ? start : start + start_height / (start_height - image_height) * (image - start);
    if (!rounded.bounds_hold(path.point[i])) return false;
    start = path.point[i];
    image = plane.mirror(image);
  }
  return true;
}

/// The second plane of an edge, reflection i: no segment to trace, only its side to keep to.  Returns its material.
std::uint32_t pass_edge(const AcousticScene& scene, std::size_t i, glm::vec3 listener, glm::vec3& origin, MirrorPath& path) {
  const auto num_planes = static_cast<std::uint32_t>(scene.planes().size());
  const FoldedPlanes& folds = scene.folds();
  const std::uint32_t index = path.sequence.plane[i];
  const MirrorPlane& plane = mirror_at(scene, index);
  const bool fold = index >= num_planes;
  path.met_plane[i] = fold ? folds.some_plane[index - num_planes] : index;
  path.met_fold[i] = fold ? index - num_planes : static_cast<std::uint32_t>(folds.planes.size());
  origin = offset_from_surface(origin, ExactPlane(plane).height(glm::dvec3(listener)) > 0 ? plane.normal : -plane.normal);
  return plane.material;
}

/// Is the triangle that reflection i meets, after `hit_m` instead of `segment_m`, one of its plane?
bool meets_its_plane(const AcousticScene& scene, bool by_folds, std::size_t i, double hit_m, double segment_m, const MirrorPath& path) {
  const bool of_fold = by_folds && path.met_fold[i] < scene.folds().planes.size();
  const std::uint32_t met = of_fold ? static_cast<std::uint32_t>(scene.planes().size()) + path.met_fold[i] : path.met_plane[i];
  if (met == path.sequence.plane[i]) return true;
  // At an edge rounding decides which of its planes the ray meets; the point is the same.
  const auto planes = path.planes();
  const bool other_plane_of_edge = std::find(planes.begin(), planes.end(), met) != planes.end();
  return other_plane_of_edge && !(std::abs(hit_m - segment_m) > 1e-5 * (segment_m + scene.diagonal_m()));
}

/// By rays: is the first thing that each segment meets a triangle of its plane?  Notes what the path meets and keeps.
/// standing: what is no obstacle to a single reflection; null: none.
bool confirm_segments(const AcousticScene& scene, bool by_folds, const StandingPanels* standing, glm::vec3 listener, glm::vec3 source,
                      MirrorPath& path) {
  const EmbreeScene& rays = scene.scene().rays();
  const FoldedPlanes& folds = scene.folds();
  path.energy_fraction.fill(1.0);
  glm::vec3 origin = listener;
  for (std::size_t i = path.order(); i-- > 0;) {
    const glm::dvec3 segment = path.point[i] - glm::dvec3(origin);
    const double segment_m = glm::length(segment);
    std::uint32_t material;
    if (i + 1 < path.order() && segment_m < 1e-5 * scene.diagonal_m()) {
      material = pass_edge(scene, i, listener, origin, path);
    } else {
      const glm::vec3 toward(segment / segment_m);
      const Hit hit = standing != nullptr ? standing->hit_past(origin, toward) : rays.intersect(origin, toward);
      if (!hit.valid()) return false;
      path.met_plane[i] = scene.plane_of_triangle()[hit.triangle];
      if (!folds.planes.empty()) path.met_fold[i] = folds.fold_of_triangle[hit.triangle];
      if (!meets_its_plane(scene, by_folds, i, hit.distance_m, segment_m, path)) return false;
      material = scene.scene().mesh().triangle_material[hit.triangle];
      origin = offset_from_surface(hit.position, hit.normal);
    }
    for (int band = 0; band < scene.num_bands(); ++band) {
      const MirrorReflection reflection = mirror_reflection(scene, material, band, path.cosine[i]);
      path.energy_fraction[band] *= reflection.energy_fraction;
      path.phase_rad[band] += reflection.phase_rad;
    }
  }
  return standing != nullptr ? standing->is_free(origin, source) : !rays.occluded(origin, source);
}

/// An image with panels of finite size, as fractions of its energy.
struct PanelFactor {
  std::array<double, kMaxBands> energy_fraction, phase_rad{};
  std::array<double, kMaxBands> reflected;  ///< to all sides together: the rest passes round the panels
  bool finite = false;                      ///< is any panel?
};

PanelFactor find_panel_factor(const AcousticScene& scene, const DiffractionCandidates& edge_waves, glm::dvec3 source, glm::dvec3 listener,
                              double distance_m, const MirrorPath& path) {
  PanelFactor product;
  product.energy_fraction.fill(1.0);
  product.reflected.fill(1.0);
  if (scene.panel_edges() == nullptr) return product;
  const auto num_planes = static_cast<std::uint32_t>(scene.planes().size());
  const double longest_wave_m = scene.speed_of_sound_m_per_s() / scene.bands().centre_hz.front();
  const bool alone = path.order() == 1;
  glm::dvec3 image = source;
  for (std::size_t i = 0; i < path.order(); ++i) {
    const std::uint32_t plane = path.sequence.plane[i];
    const glm::dvec3 start = image;
    image = ExactPlane(mirror_at(scene, plane)).mirror(image);
    const auto edges = plane >= num_planes ? scene.fold_edges()->of(plane - num_planes) : scene.panel_edges()->of(plane);
    const double before_m = glm::length(path.point[i] - image);
    if (edges.empty() || !(before_m > 0)) continue;
    const PanelShape* const shape = plane < num_planes ? scene.panel_shapes()->find(plane, path.point[i], start) : nullptr;
    const PanelReflection panel(edges, image, image + (path.point[i] - image) * (distance_m / before_m), path.point[i], longest_wave_m);
    if (shape == nullptr && !panel.finite()) continue;
    product.finite = true;
    for (const EdgeBands& bands : edge_waves.bands()) {
      const PanelReflection::Factor factor =
          shape != nullptr && alone ? PanelWave(*shape, source, listener).factor(bands.wave) : panel.factor(bands.wave.number);
      for (int lane = 0; lane < bands.count; ++lane) {
        const int band = bands.first + lane;
        double energy = double{factor.energy[lane]}, reflected = 1;
        if (shape != nullptr) {
          const double cosine = std::abs(glm::dot(shape->normal, path.point[i] - image)) / before_m;
          if (!alone) energy *= small_panel_gain(*shape, bands.wave.exact[lane], cosine);
          reflected = reflected_fraction(*shape, bands.wave.exact[lane], cosine);
        }
        product.energy_fraction[band] *= energy;
        product.reflected[band] *= reflected;
        product.phase_rad[band] += double{factor.phase_rad[lane]};
      }
    }
    // The rest of a single panel goes to its sides: as its wave there, or with its edges.
    const bool has_wave = shape != nullptr && edge_waves.has_wave(static_cast<std::uint32_t>(shape - scene.panel_shapes()->all().data()));
    if (alone && (has_wave || !DiffractionBudget(scene.config()).near_boundary_only)) product.reflected.fill(0.0);
  }
  return product;
}

}  // namespace

EarlyCandidates::EarlyCandidates(const AcousticScene& scene, const SoundSource& sound_source, SourceMotion motion)
    : source_(sound_source), emission_(sound_source, scene.bands()), diffraction_(scene, checked_position(sound_source)) {
  const FlushDenormals flush;
  wall_gain_ = scene.wall_gain(source());
  const int order = scene.image_order();
  const auto num_planes = static_cast<std::uint32_t>(scene.planes().size());
  if (order == 0 || num_planes == 0) return;
  if (auto chains = std::make_shared<const LongChains>(scene, sound_source); !chains->empty()) long_chains_ = std::move(chains);

  if (!append_all_sequences(order, num_planes, sequences_)) append_met_sequences(scene, source(), motion, sequences_);
  append_panels(scene);
  std::sort(sequences_.begin(), sequences_.end());
  sequences_.erase(std::unique(sequences_.begin(), sequences_.end()), sequences_.end());
  num_by_planes_ = sequences_.size();
  if (!scene.folds().planes.empty()) add_folds(scene);
  sequences_.shrink_to_fit();  // of thousands of rays hundreds of sequences remain, and thousands of sources may be held
  find_images(scene);
}

void EarlyCandidates::append_panels(const AcousticScene& scene) {
  for (const std::uint32_t index : diffraction_.panels()) {
    const PanelShape& panel = scene.panel_shapes()->all()[index];
    Sequence& alone = sequences_.emplace_back();
    alone.plane[0] = panel.plane;
    alone.order = 1;
    if (!panel.stands() || scene.image_order() < 2) continue;
    for (const bool base_first : {false, true}) {
      Sequence& by_base = sequences_.emplace_back();
      by_base.plane[base_first ? 1 : 0] = panel.plane;
      by_base.plane[base_first ? 0 : 1] = panel.base_plane;
      by_base.order = 2;
    }
  }
}

void EarlyCandidates::find_images(const AcousticScene& scene) {
  images_.reserve(sequences_.size());
  for (auto* rows : {&last_.normal, &last_.image, &last_.lower, &last_.upper})
    for (std::vector<double>& row : *rows) row.reserve(sequences_.size());
  last_.offset_m.reserve(sequences_.size());
  last_.image_height_m.reserve(sequences_.size());
  for (const Sequence& sequence : sequences_) {
    glm::dvec3 image(source());
    for (int i = 0; i < sequence.order; ++i) image = ExactPlane(mirror_at(scene, sequence.plane[i])).mirror(image);
    images_.push_back(image);
    const MirrorPlane& rounded = mirror_at(scene, sequence.plane[static_cast<std::size_t>(sequence.order - 1)]);
    const ExactPlane plane(rounded);
    for (int axis = 0; axis < 3; ++axis) {
      const auto a = static_cast<std::size_t>(axis);
      last_.normal[a].push_back(plane.normal[axis]);
      last_.image[a].push_back(image[axis]);
      last_.lower[a].push_back(static_cast<double>(rounded.bounds.lower[axis]) - kSlackM);
      last_.upper[a].push_back(static_cast<double>(rounded.bounds.upper[axis]) + kSlackM);
    }
    last_.offset_m.push_back(plane.offset_m);
    last_.image_height_m.push_back(plane.height(image));
  }
}

void EarlyCandidates::cull(std::size_t first, glm::dvec3 listener, std::span<std::uint8_t> possible) const {
  const double x = listener.x, y = listener.y, z = listener.z;
  const double *nx = &last_.normal[0][first], *ny = &last_.normal[1][first], *nz = &last_.normal[2][first];
  const double *ix = &last_.image[0][first], *iy = &last_.image[1][first], *iz = &last_.image[2][first];
  const double *lx = &last_.lower[0][first], *ly = &last_.lower[1][first], *lz = &last_.lower[2][first];
  const double *ux = &last_.upper[0][first], *uy = &last_.upper[1][first], *uz = &last_.upper[2][first];
  const double *offset = &last_.offset_m[first], *height = &last_.image_height_m[first];
  std::uint8_t* __restrict out = possible.data();
  for (std::size_t i = 0; i < possible.size(); ++i) {
    const double listener_height = nx[i] * x + ny[i] * y + nz[i] * z - offset[i], image_height = height[i];
    const double fraction = listener_height / (listener_height - image_height);
    const double px = x + fraction * (ix[i] - x), py = y + fraction * (iy[i] - y), pz = z + fraction * (iz[i] - z);
    const bool inside_bounds = (px >= lx[i]) & (px <= ux[i]) & (py >= ly[i]) & (py <= uy[i]) & (pz >= lz[i]) & (pz <= uz[i]);
    out[i] = static_cast<std::uint8_t>((listener_height * image_height < kSlackM * kSlackM) & inside_bounds);
  }
}

bool EarlyCandidates::find_sequence(std::span<const std::uint32_t> planes, std::size_t begin, std::size_t end) const {
  if (planes.empty() || planes.size() > kMaxOrder) return false;
  Sequence key;
  std::copy(planes.begin(), planes.end(), key.plane.begin());
  key.order = static_cast<int>(planes.size());
  return std::binary_search(sequences_.begin() + static_cast<std::ptrdiff_t>(begin), sequences_.begin() + static_cast<std::ptrdiff_t>(end),
                            key);
}

bool EarlyCandidates::contains(std::span<const std::uint32_t> planes) const { return find_sequence(planes, 0, num_by_planes_); }

bool EarlyCandidates::find_path(const AcousticScene& scene, std::size_t index, glm::vec3 listener, bool with_standing, Arrival& arrival,
                                Arrival& scattered) const {
  const Sequence& sequence = sequences_[index];
  const glm::dvec3 from_listener = images_[index] - glm::dvec3(listener);
  const double distance_m = std::max(glm::length(from_listener), double{kMinDistanceM});
  if (distance_m > scene.max_path_m()) return false;

  const bool by_folds = index >= num_by_planes_;
  MirrorPath path(sequence);
  if (!find_reflection_points(scene, images_[index], glm::dvec3(listener), path)) return false;
  const std::size_t order = path.order();
  if (with_standing && is_standing_wave(scene, path.planes(), std::span(path.point).first(order))) return false;
  const StandingPanels standing(scene, diffraction_.panels(), path.planes().front());
  if (!confirm_segments(scene, by_folds, with_standing && order == 1 ? &standing : nullptr, listener, source(), path)) return false;
  if (!scene.folds().planes.empty() && !weigh_folds(scene, std::span(path.met_plane).first(order), std::span(path.met_fold).first(order),
                                                    by_folds, listener, path.energy_fraction))
    return false;
  const PanelFactor panels = find_panel_factor(scene, diffraction_, glm::dvec3(source()), glm::dvec3(listener), distance_m, path);

  const glm::dvec3 departure = path.point[0] - glm::dvec3(source());
  arrival.kind = ArrivalKind::reflection;
  arrival.phase_rad.fill(0.f);
  for (int band = 0; scene.surfaces().any_reacts_locally() && band < scene.num_bands(); ++band)
    arrival.phase_rad[band] = static_cast<float>(std::remainder(path.phase_rad[band], 2.0 * std::numbers::pi));
  arrival.identity = path_identity(arrival.kind, path.planes());
  arrival.departure = glm::vec3(departure / std::max(glm::length(departure), 1e-12));
  arrival.distance_m = static_cast<float>(distance_m);
  arrival.direction = glm::vec3(from_listener / glm::length(from_listener));
  arrival.order = sequence.order;
  if (!panels.finite) {
    scattered.order = 0;
    return set_amplitude(scene, distance_m, path.energy_fraction, arrival);
  }
  scattered = arrival;
  std::array<double, kMaxBands> lost{};
  for (int band = 0; band < scene.num_bands(); ++band) {
    lost[band] = path.energy_fraction[band] * std::max(panels.reflected[band] - panels.energy_fraction[band], 0.0);
    path.energy_fraction[band] *= panels.energy_fraction[band];
    arrival.phase_rad[band] = static_cast<float>(std::remainder(path.phase_rad[band] + panels.phase_rad[band], 2.0 * std::numbers::pi));
  }
  if (!set_amplitude(scene, distance_m, lost, scattered)) scattered.order = 0;
  return set_amplitude(scene, distance_m, path.energy_fraction, arrival);
}

bool EarlyCandidates::set_direct(const AcousticScene& scene, glm::vec3 source, glm::vec3 listener, Arrival& direct) {
  if (scene.config().direct == Switch::off) return false;
  const glm::dvec3 toward = glm::dvec3(source) - glm::dvec3(listener);
  const double true_distance_m = glm::length(toward);
  const double distance_m = std::max(true_distance_m, double{kMinDistanceM});
  if (distance_m > scene.max_path_m()) return false;
  direct = Arrival{};
  direct.identity = path_identity(direct.kind, {});
  direct.distance_m = static_cast<float>(distance_m);
  direct.direction = true_distance_m > 0 ? glm::vec3(toward / true_distance_m) : glm::vec3(0, 0, -1);
  direct.departure = -direct.direction;
  std::array<double, kMaxBands> whole;
  whole.fill(1.0);
  set_amplitude(scene, distance_m, whole, direct);
  return true;
}

void EarlyCandidates::find_arrivals(const AcousticScene& scene, glm::vec3 listener, std::vector<Arrival>& arrivals) const {
  find_arrivals(scene, listener, in_line_of_sight(scene, source(), listener), arrivals);
}

void EarlyCandidates::find_arrivals(const AcousticScene& scene, glm::vec3 listener, bool in_sight, std::vector<Arrival>& arrivals) const {
  find_arrivals(scene, listener, in_sight, arrivals, nullptr);
}

void EarlyCandidates::find_arrivals(const AcousticScene& scene, glm::vec3 listener, bool in_sight, std::vector<Arrival>& arrivals,
                                    std::vector<Arrival>* scattered) const {
  const std::size_t first = arrivals.size();
  if (Arrival direct; in_sight && set_direct(scene, source(), listener, direct)) arrivals.push_back(direct);

  const std::size_t first_image = arrivals.size();
  const bool with_standing = in_sight && diffraction_.has_standing();
  std::size_t first_by_folds = 0;  // an image by folds and one by planes may be the same and share its energy
  Arrival arrival, missing;
  std::array<std::uint8_t, 256> possible;
  for (std::size_t i = 0; i < sequences_.size(); ++i) {
    if (i % possible.size() == 0)
      cull(i, glm::dvec3(listener), std::span(possible).first(std::min(possible.size(), sequences_.size() - i)));
    if (possible[i % possible.size()] == 0) continue;
    if (!find_path(scene, i, listener, with_standing, arrival, missing)) continue;
    if (i >= num_by_planes_ && first_by_folds == 0) first_by_folds = arrivals.size();
    const bool known = std::any_of(arrivals.begin() + static_cast<std::ptrdiff_t>(std::max(first_image, first_by_folds)), arrivals.end(),
                                   [&](const Arrival& other) { return same_path(arrival, other); });
    if (known) continue;
    arrivals.push_back(arrival);
    if (scattered != nullptr && missing.order > 0) scattered->push_back(missing);
  }
  if (in_sight) find_panel_waves(scene, listener, with_standing, arrivals, scattered);
  if (with_standing) find_standing_waves(scene, listener, arrivals, scattered);
  // Insertion sort: a few dozen entries, stable (ties stay in the order of their sequences), no allocation.
  for (std::size_t i = first + 1; i < arrivals.size(); ++i) {
    for (std::size_t j = i; j > first && arrivals[j].distance_m < arrivals[j - 1].distance_m; --j) {
      std::swap(arrivals[j], arrivals[j - 1]);
    }
  }
}

}  // namespace earshot
