// SPDX-License-Identifier: Apache-2.0
#include "sim/acoustics/paths/edge_reflections.h"

#include <algorithm>
#include <cmath>
#include <complex>
#include <glm/geometric.hpp>
#include <numbers>
#include <tuple>

#include "sim/acoustics/geometry/exact_plane.h"
#include "sim/acoustics/paths/panel_reflection.h"

namespace earshot {
namespace {

constexpr std::uint32_t kPlaneBit = 0x80000000u;  // tells planes from edges in an identity

double energy_of(const Arrival& arrival) {
  double sum = 0;
  for (const float amplitude : arrival.amplitude) sum += double{amplitude} * amplitude;
  return sum;
}

}  // namespace

void add_wave(std::span<const EdgeBands> groups, const Arrival& wave, Arrival& path) {
  const double later_m = double{wave.distance_m} - path.distance_m;
  for (const EdgeBands& bands : groups) {
    Lanes amplitude{}, phase{}, added{}, added_phase{};
    for (int lane = 0; lane < bands.count; ++lane) {
      amplitude[lane] = path.amplitude[bands.first + lane];
      phase[lane] = path.phase_rad[bands.first + lane];
      added[lane] = wave.amplitude[bands.first + lane];
      added_phase[lane] = wave.phase_rad[bands.first + lane];
    }
    const ComplexLanes sum = amplitude * unit_phase(phase) + added * (unit_phase(added_phase) * conj(bands.wave.turn(later_m)));
    const Lanes size = root_of(norm(sum)), angle = argument(sum);
    for (int lane = 0; lane < bands.count; ++lane) {
      if (!(added[lane] > 0.f)) continue;
      path.amplitude[bands.first + lane] = size[lane];
      path.phase_rad[bands.first + lane] = angle[lane];
    }
  }
}

void cap_at_free_field(int num_bands, glm::dvec3 from, glm::dvec3 to, std::span<Arrival> waves) {
  const double straight_m = std::max(glm::length(from - to), double{kMinDistanceM});
  const double most = 1.0 / (4.0 * std::numbers::pi * straight_m * 4.0 * std::numbers::pi * straight_m);
  for (int band = 0; band < num_bands; ++band) {
    double energy = 0;
    for (const Arrival& wave : waves) energy += double{wave.amplitude[band]} * wave.amplitude[band];
    if (energy <= most) continue;
    const double gain = std::sqrt(most / energy) * (1.0 - 1e-6);
    for (Arrival& wave : waves) wave.amplitude[band] = static_cast<float>(gain * wave.amplitude[band]);
  }
}

/// From an end of the path to the nearest edge.
struct EdgeReflections::EndSegment {
  glm::dvec3 toward{0};                      ///< unit, from the end of the path
  std::array<double, kMaxBands> pressure{};  ///< factors of the plane
};

/// Segments at both ends of the path as it is worked out.
struct EdgeReflections::EndSegments {
  EndSegment first, last;
};

EdgeReflections::EdgeReflections(const AcousticScene& scene, std::span<const EdgeBands> bands, glm::vec3 source, glm::vec3 listener,
                                 std::span<Arrival> images, std::span<const double> sight_weight)
    : scene_(scene),
      bands_(bands),
      swapped_(std::tie(listener.x, listener.y, listener.z) < std::tie(source.x, source.y, source.z)),
      from_(swapped_ ? listener : source),
      to_(swapped_ ? source : listener),
      images_(images),
      sight_weight_(sight_weight) {}

bool EdgeReflections::follow(glm::dvec3 from, int plane, glm::vec3 to, EndSegment& segment) const {
  const EmbreeScene& rays = scene_.scene().rays();
  segment.pressure.fill(1.0);
  if (plane < 0) {
    const double length_m = glm::length(glm::dvec3(to) - from);
    if (!(length_m > 0)) return false;
    segment.toward = (glm::dvec3(to) - from) / length_m;
    return !rays.occluded(glm::vec3(from), to);
  }
  const MirrorPlane& rounded = scene_.planes()[static_cast<std::size_t>(plane)];
  const ExactPlane mirror(rounded);
  const double from_height = mirror.height(from), to_height = mirror.height(glm::dvec3(to));
  if (!(from_height * to_height > 0)) return false;
  const glm::dvec3 image = mirror.mirror(glm::dvec3(to));
  if (!rounded.bounds_hold(from + from_height / (from_height + to_height) * (image - from))) return false;
  segment.toward = glm::normalize(image - from);
  const Hit hit = rays.intersect(glm::vec3(from), glm::vec3(segment.toward));
  if (!hit.valid() || scene_.plane_of_triangle()[hit.triangle] != static_cast<std::uint32_t>(plane)) return false;
  if (rays.occluded(offset_from_surface(hit.position, hit.normal), to)) return false;
  const std::uint32_t material = scene_.scene().mesh().triangle_material[hit.triangle];
  bool is_audible = false;
  for (int band = 0; band < scene_.num_bands(); ++band) {
    segment.pressure[band] = std::sqrt(double{scene_.reflectance(material)[band]} * (1.0 - scene_.scattering(material)[band]));
    is_audible = is_audible || segment.pressure[band] > 0;
  }
  return is_audible;
}

bool EdgeReflections::find_path(const EdgeSequence& sequence, EndPlanes planes, Arrival& arrival, int& image_path) const {
  const DiffractionEdges& edges = *scene_.diffraction_edges();
  EdgePath path;
  if (!shortest_path(edges, sequence, image_of(from_, planes.first), image_of(to_, planes.second), path)) return false;
  if (path.distance_m() > scene_.max_path_m()) return false;
  const EdgePathField field(edges, path, false);
  if (!field.valid()) return false;

  image_path = find_image_path(planes);
  const bool joins_image = image_path >= 0;
  // Energy is complete where images are in sight: there only the waves of single edges count, and the image is the place for them.
  if (joins_image && sequence.order > 1) return false;
  if (!joins_image && sequence.order == 1 && field.first_edge().endless().weight(0) < 0) return false;

  std::array<double, kMaxBands> weight;
  if (!weigh_bands(edges[sequence.edge[0]], field.first_edge(), joins_image, weight)) return false;
  EndSegments ends;
  if (!follow_segments(path, planes, ends)) return false;
  describe(path, planes, ends, arrival);
  for (int band = 0; band < scene_.num_bands(); ++band) weight[band] = weight[band] * ends.first.pressure[band] * ends.last.pressure[band];
  return set_field(path, field, joins_image, weight, arrival);
}

glm::dvec3 EdgeReflections::image_of(glm::vec3 end, int plane) const {
  return plane < 0 ? glm::dvec3(end) : ExactPlane(scene_.planes()[static_cast<std::size_t>(plane)]).mirror(glm::dvec3(end));
}

int EdgeReflections::find_image_path(EndPlanes planes) const {
  const EndPlanes from_source = in_order_from_source(planes);
  std::array<std::uint32_t, 2> met;
  std::size_t num_planes = 0;
  for (const int plane : {from_source.first, from_source.second})
    if (plane >= 0) met[num_planes++] = static_cast<std::uint32_t>(plane);
  const std::uint64_t image = path_identity(ArrivalKind::reflection, std::span(met).first(num_planes));
  for (std::size_t i = 0; i < images_.size(); ++i)
    if (images_[i].identity == image) return static_cast<int>(i);
  return -1;
}

bool EdgeReflections::weigh_bands(const DiffractionEdge& first_edge, const FiniteWedge& wedge, bool joins_image,
                                  std::span<double> weight) const {
  std::fill(weight.begin(), weight.end(), 1.0);
  if (!joins_image && sight_weight_.empty()) return true;
  const double straight_detour_m = sight_weight_.empty() ? 0 : FiniteWedge(first_edge, glm::dvec3(from_), glm::dvec3(to_)).detour_m(0);
  double most_weight = 0;
  for (int band = 0; band < scene_.num_bands(); ++band) {
    const double wavenumber = 2.0 * std::numbers::pi * scene_.bands().centre_hz[band] / scene_.speed_of_sound_m_per_s();
    const double waves_per_m = wavenumber / (2.0 * std::numbers::pi);
    weight[band] = boundary_weight(waves_per_m * wedge.detour_m(0));
    // In sight what belongs to no image fades away from the shadow boundary as the edge's own wave does.
    if (!joins_image)
      weight[band] =
          std::max({weight[band], boundary_weight(waves_per_m * straight_detour_m), sight_weight_[static_cast<std::size_t>(band)]});
    most_weight = std::max(most_weight, weight[band]);
  }
  return most_weight > 0;
}

bool EdgeReflections::follow_segments(const EdgePath& path, EndPlanes planes, EndSegments& ends) const {
  const DiffractionEdges& edges = *scene_.diffraction_edges();
  const auto order = static_cast<std::size_t>(path.sequence.order);
  const auto air_point = [&](std::size_t i) { return edges.inset_air_point(path.sequence.edge[i], path.along_m[i]); };
  if (!follow(glm::dvec3(from_), planes.first, air_point(0), ends.first)) return false;
  if (!follow(glm::dvec3(to_), planes.second, air_point(order - 1), ends.last)) return false;
  for (std::size_t i = 1; i < order; ++i)
    if (scene_.scene().rays().occluded(air_point(i - 1), air_point(i))) return false;
  return true;
}

void EdgeReflections::describe(const EdgePath& path, EndPlanes planes, const EndSegments& ends, Arrival& arrival) const {
  const auto order = static_cast<std::size_t>(path.sequence.order);
  const EndPlanes from_source = in_order_from_source(planes);
  std::array<std::uint32_t, kMaxDiffractionOrder + 2> met;
  std::size_t count = 0;
  if (from_source.first >= 0) met[count++] = static_cast<std::uint32_t>(from_source.first) | kPlaneBit;
  for (std::size_t i = 0; i < order; ++i) met[count++] = path.sequence.edge[swapped_ ? order - 1 - i : i];
  if (from_source.second >= 0) met[count++] = static_cast<std::uint32_t>(from_source.second) | kPlaneBit;
  arrival = Arrival{};
  arrival.kind = ArrivalKind::diffraction;
  arrival.identity = path_identity(arrival.kind, std::span(met).first(count));
  arrival.order = static_cast<int>(count);
  arrival.distance_m = static_cast<float>(path.distance_m());
  arrival.departure = glm::vec3(swapped_ ? ends.last.toward : ends.first.toward);
  arrival.direction = glm::vec3(swapped_ ? ends.first.toward : ends.last.toward);
}

bool EdgeReflections::set_field(const EdgePath& path, const EdgePathField& field, bool joins_image, std::span<const double> gain,
                                Arrival& arrival) const {
  const double distance_m = path.distance_m();
  bool is_audible = false;
  for (const EdgeBands& bands : bands_) {
    ComplexLanes ratio;
    if (!joins_image) {
      ratio = field.ratio(bands);
    } else {
      const DiffractionEdge& edge = (*scene_.diffraction_edges())[path.sequence.edge[0]];
      const FiniteWedge& wedge = field.first_edge();
      FaceFactorLanes only_incidence;
      only_incidence.incidence = 1.f - bands.transmitted(edge.first_material, edge.second_material);
      ratio = wedge.ratio(bands.wave, wedge.own_length_m(), only_incidence);
    }
    const Lanes amplitude = root_of(norm(ratio)) * bands.free_path(distance_m), phase = argument(ratio);
    for (int lane = 0; lane < bands.count; ++lane) {
      const int band = bands.first + lane;
      arrival.amplitude[band] = static_cast<float>(gain[band]) * amplitude[lane];
      arrival.phase_rad[band] = phase[lane];
      is_audible = is_audible || arrival.amplitude[band] > 0.f;
    }
  }
  return is_audible;
}

void EdgeReflections::keep(const Arrival& arrival) {
  if (count_ < kMost) {
    arrival_[count_++] = arrival;
    return;
  }
  const auto weakest =
      std::min_element(arrival_.begin(), arrival_.end(), [](const Arrival& a, const Arrival& b) { return energy_of(a) < energy_of(b); });
  if (energy_of(*weakest) < energy_of(arrival)) *weakest = arrival;
}

std::span<const Arrival> EdgeReflections::find(std::span<const EdgeSequence> sequences) {
  const DiffractionEdges& edges = *scene_.diffraction_edges();
  const std::size_t num_sequences = std::min(sequences.size(), kSequences);
  std::array<EdgeSequence, kSequences> sequence;
  for (std::size_t i = 0; i < num_sequences; ++i) {
    sequence[i] = sequences[i];
    if (swapped_) std::reverse(sequence[i].edge.begin(), sequence[i].edge.begin() + sequence[i].order);
  }
  const int num_planes = static_cast<int>(std::min(scene_.planes().size(), kPlanes));
  // Does a plane have an end and the edge next to it on one side?  Not an edge of its own: the wedge's field has that reflection.
  const double apart_m = 10.0 * edges.clearance_m();
  const auto sees = [&](glm::vec3 end, std::uint32_t edge, int plane) {
    if (plane < 0) return true;
    const ExactPlane mirror(scene_.planes()[static_cast<std::size_t>(plane)]);
    const double side = mirror.height(glm::dvec3(end)) < 0 ? -1.0 : 1.0;
    return std::max(side * mirror.height(edges[edge].at(0)), side * mirror.height(edges[edge].at(edges[edge].length_m))) > apart_m;
  };
  count_ = 0;
  std::array<Arrival, kSequences> wave;
  for (int first = -1; first < num_planes; ++first) {
    for (int second = first < 0 ? 0 : -1; second < num_planes; ++second) {
      std::size_t count = 0;
      for (std::size_t i = 0; i < num_sequences; ++i) {
        const EdgeSequence& s = sequence[i];
        if (!sight_weight_.empty() && s.order > 1) continue;
        if (!sees(from_, s.edge[0], first) || !sees(to_, s.edge[static_cast<std::size_t>(s.order - 1)], second)) continue;
        int image_path = -1;
        if (!find_path(s, {first, second}, wave[count], image_path)) continue;
        if (image_path < 0) {
          ++count;
        } else {
          add_wave(bands_, wave[count], images_[static_cast<std::size_t>(image_path)]);
        }
      }
      if (count == 0) continue;
      const std::span<Arrival> waves = std::span(wave).first(count);
      cap_at_free_field(scene_.num_bands(), image_of(from_, first), image_of(to_, second), waves);
      for (const Arrival& arrival : waves) keep(arrival);
    }
  }
  return std::span(arrival_).first(count_);
}

}  // namespace earshot
