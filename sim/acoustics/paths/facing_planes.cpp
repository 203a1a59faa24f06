// SPDX-License-Identifier: Apache-2.0
#include "sim/acoustics/paths/facing_planes.h"

#include <algorithm>
#include <cmath>
#include <glm/geometric.hpp>
#include <numbers>
#include <span>

#include "sim/acoustics/core/sampling.h"
#include "sim/acoustics/geometry/exact_plane.h"
#include "sim/acoustics/paths/image_deposit.h"
#include "sim/acoustics/paths/mirror_decay.h"

namespace earshot {
namespace {

constexpr std::size_t kMaxSidePlanes = 24;             // per pair
constexpr double kMaxFamilies = 64, kFewFamilies = 8;  // per pair; with few rays, whose noise is larger than what side planes add
// Samples of a strip: along the line across it, at least kAcross and no further apart than kStepM, and from plane to plane.
constexpr int kAcross = 12, kMaxAcross = 240, kLevels = 4;
constexpr double kStepM = 0.25;
constexpr double kSpentFraction = 1e-8;  // of energy, after which a row of images ends

/// Along the axis of a pair from a point on one plane: the material that a ray straight across meets on the other, if it is that plane.
bool look_across(const AcousticScene& scene, glm::dvec3 from, glm::dvec3 direction, double gap_m, std::uint32_t plane,
                 std::uint32_t& material) {
  const glm::vec3 d(direction);
  const Hit hit = scene.scene().rays().intersect(offset_from_surface(glm::vec3(from), d), d);
  if (!hit.valid() || scene.plane_of_triangle()[hit.triangle] != plane) return false;
  if (std::abs(hit.distance_m - gap_m) > 1e-3 * gap_m + 1e-4 * scene.diagonal_m()) return false;
  material = scene.scene().mesh().triangle_material[hit.triangle];
  return true;
}

/// Has a plane a triangle that reflects by the angle?  [planes]
std::vector<bool> planes_that_react_locally(const AcousticScene& scene) {
  std::vector<bool> reacts(scene.planes().size(), false);
  if (!scene.surfaces().any_reacts_locally()) return reacts;
  const std::span<const std::uint32_t> plane_of_triangle = scene.plane_of_triangle();
  for (std::size_t t = 0; t < plane_of_triangle.size(); ++t)
    if (scene.surfaces().reacts_locally(scene.scene().mesh().triangle_material[t])) reacts[plane_of_triangle[t]] = true;
  return reacts;
}

}  // namespace

/// Paths of one pair and one sequence of side planes at one listener.
class FacingPlanes::Family {
 public:
  using BandFactors = std::array<double, kMaxBands>;

  /// sides: planes in the order from the source.
  Family(const AcousticScene& scene, const Pair& pair, std::span<const std::uint32_t> sides, glm::vec3 source, glm::dvec3 listener)
      : scene_(scene),
        pair_(pair),
        sides_(sides),
        source_(source),
        listener_(listener),
        source_m_(glm::dot(pair.axis, glm::dvec3(source)) - pair.offset_m),
        listener_m_(glm::dot(pair.axis, listener) - pair.offset_m) {}

  /// The line across, from the listener to the source: as in EarlyCandidates::find_path, seen along the axis.  False if there is none.
  bool find_line_across();
  /// Side planes must be there over the whole height, and nothing before them.  False for a line through the edge of two planes.
  bool average_side_factors();
  /// Both planes along that line, and nothing between them.  False if they are nowhere.
  bool average_end_factors();
  /// All images of at least `least_bounces` bounces of which the first from the listener is on plane 0 (way -1) or plane 1 (way 1).
  void add_row(int way, int least_bounces, ImageDeposit& deposit) const;

 private:
  enum class LineStatus { whole, broken, degenerate };
  /// State of sampling an obstructed strip past kTracedBounces: the fraction that comes through is that of two paths out of each run of a
  /// quarter more bounces.  A wide obstacle blocks all of them from some length on: the row ends with two runs of which nothing
  /// is left.
  struct RunSample {
    int end = kTracedBounces;  ///< bounces at which the run ends
    int blocked_runs = 0;      ///< in a row, of which nothing came through
    double passing = 1;        ///< fraction that comes through in this run
  };

  [[nodiscard]] std::size_t num_sides() const { return sides_.size(); }
  [[nodiscard]] ExactPlane side(std::size_t i) const { return ExactPlane(scene_.planes()[sides_[i]]); }
  [[nodiscard]] glm::dvec3 flat(glm::dvec3 v) const { return v - glm::dot(pair_.axis, v) * pair_.axis; }
  /// A point of the strip: by its place across, at a height over plane 0.
  [[nodiscard]] glm::dvec3 at(glm::dvec3 point, double height_m) const { return flat(point) + (pair_.offset_m + height_m) * pair_.axis; }
  /// Place of the image of n bounces along the axis, from the listener.
  [[nodiscard]] double rise_of(int way, int n) const {
    return way * n * pair_.gap_m + (n % 2 == 0 ? source_m_ : pair_.gap_m - source_m_) - listener_m_;
  }
  /// Follows the line across at one height; `product`: energy that its side planes reflect.
  LineStatus trace_line(double height_m, BandFactors& product);
  /// The point of the line across after `to_go_m` of it.
  [[nodiscard]] glm::dvec3 place_on_line(double to_go_m) const;
  /// The path of `bounces` between the planes whose image lies `rise_m` along the axis: follows it and keeps what it meets.
  bool follow(int bounces, double rise_m, BandFactors& energy) const;
  /// Starts the run of n bounces.  False if the row ends before it.
  bool sample_run(int way, int n, RunSample& run) const;

  const AcousticScene& scene_;
  const Pair& pair_;
  std::span<const std::uint32_t> sides_;
  glm::vec3 source_;
  glm::dvec3 listener_;
  double source_m_, listener_m_;                  ///< heights over plane 0
  glm::dvec3 across_{0};                          ///< from the listener to the images, at right angles to the axis
  glm::dvec3 departure_{0};                       ///< the same as the sound leaves the source
  std::array<glm::dvec3, kMaxSides + 2> corner_;  ///< of the line across: listener, side planes, source
  std::array<double, kMaxSides + 2> along_m_{};   ///< length of the line to each corner
  std::array<BandFactors, 2> end_factor_;         ///< energy fraction of a bounce on either plane
  BandFactors side_factor_;                       ///< of all side planes together
  bool free_ = true;                              ///< nothing stands in the strip
};

FacingPlanes::FacingPlanes(const AcousticScene& scene, const SoundSource& source) : source_(source), emission_(source, scene.bands()) {
  least_bounces_ = static_cast<std::uint16_t>(scene.image_order() + 1);
  // Without image paths mirrors are the tracers' alone.
  if (scene.image_order() > 0) find_pairs(scene);
}

void FacingPlanes::find_pairs(const AcousticScene& scene) {
  const EmbreeScene& rays = scene.scene().rays();
  const DiffuseDecay decay(scene, source_.position);
  // Every image of a row meets such a plane at an angle of its own, and a family has one factor for all: the tracers have these paths.
  const std::vector<bool> by_angle = planes_that_react_locally(scene);
  std::vector<glm::dvec3> axes;
  const std::span<const MirrorPlane> planes = scene.planes();
  for (std::size_t i = 0; i < std::min(planes.size(), FacingPlanes::kMaxPlanes) && pairs_.size() < kMaxPairs; ++i) {
    const ExactPlane plane(planes[i]);
    const bool known = std::any_of(axes.begin(), axes.end(), [&](glm::dvec3 axis) {
      return glm::length(glm::cross(axis, plane.normal)) < FacingPlanes::kParallelSine;
    });
    if (known) continue;
    axes.push_back(plane.normal);
    const Hit ahead = rays.intersect(source_.position, glm::vec3(plane.normal)),
              behind = rays.intersect(source_.position, -glm::vec3(plane.normal));
    if (!ahead.valid() || !behind.valid()) continue;
    Pair pair;
    pair.plane = {scene.plane_of_triangle()[behind.triangle], scene.plane_of_triangle()[ahead.triangle]};
    if (pair.plane[0] == pair.plane[1] || by_angle[pair.plane[0]] || by_angle[pair.plane[1]]) continue;
    const ExactPlane near(planes[pair.plane[0]]), far(planes[pair.plane[1]]);
    if (glm::length(glm::cross(near.normal, plane.normal)) > FacingPlanes::kParallelSine ||
        glm::length(glm::cross(far.normal, plane.normal)) > FacingPlanes::kParallelSine)
      continue;
    pair.axis = glm::dot(near.normal, plane.normal) > 0 ? near.normal : -near.normal;
    const glm::dvec3 source(source_.position);
    pair.offset_m = glm::dot(pair.axis, source) - std::abs(near.height(source));
    pair.gap_m = std::abs(near.height(source)) + std::abs(far.height(source));
    const auto& material = scene.scene().mesh().triangle_material;
    if (!decay.exceeded_by(material[behind.triangle], material[ahead.triangle], pair.gap_m)) continue;
    find_sides(scene, by_angle, pair);
    pairs_.push_back(std::move(pair));
  }
}

void FacingPlanes::find_sides(const AcousticScene& scene, const std::vector<bool>& by_angle, Pair& pair) const {
  const std::span<const MirrorPlane> planes = scene.planes();
  pair.role.assign(planes.size(), kNone);
  for (std::uint32_t p = 0; p < planes.size() && pair.side.size() < kMaxSidePlanes; ++p) {
    if (by_angle[p] || std::abs(glm::dot(ExactPlane(planes[p]).normal, pair.axis)) > FacingPlanes::kParallelSine) continue;
    pair.side.push_back(p);
    pair.role[p] = kSide;
  }
  for (const std::uint32_t p : pair.plane) pair.role[p] = kEnd;
  const auto count = static_cast<double>(pair.side.size());
  double sequences = count, families = 1;
  for (pair.max_sides = 0; pair.max_sides < std::min(scene.image_order(), kMaxSides); ++pair.max_sides) {
    families += sequences;
    if (count == 0 || families > (scene.config().rays < FacingPlanes::kManyRays ? kFewFamilies : kMaxFamilies)) break;
    sequences *= count - 1;
  }
}

std::vector<std::uint32_t> FacingPlanes::rule() const {
  std::vector<std::uint32_t> numbers;
  for (const Pair& pair : pairs_) {
    numbers.insert(numbers.end(), pair.plane.begin(), pair.plane.end());
    numbers.push_back(static_cast<std::uint32_t>(pair.max_sides));
  }
  return numbers;
}

void FacingPlanes::add_late(const AcousticScene& scene, glm::vec3 listener, EnergyHistogram& histogram) const {
  for (const Pair& pair : pairs_) {
    const double height_m = glm::dot(pair.axis, glm::dvec3(listener)) - pair.offset_m;
    if (!(height_m > 0 && height_m < pair.gap_m)) continue;
    Sequence sides{};
    add_families(scene, pair, glm::dvec3(listener), sides, 0, histogram);
  }
}

void FacingPlanes::add_families(const AcousticScene& scene, const Pair& pair, glm::dvec3 listener, Sequence& sides, int num_sides,
                                EnergyHistogram& histogram) const {
  add_family(scene, pair, listener, std::span(sides).first(static_cast<std::size_t>(num_sides)), histogram);
  if (num_sides == pair.max_sides) return;
  for (const std::uint32_t plane : pair.side) {
    if (num_sides > 0 && sides[static_cast<std::size_t>(num_sides) - 1] == plane) continue;
    sides[static_cast<std::size_t>(num_sides)] = plane;
    add_families(scene, pair, listener, sides, num_sides + 1, histogram);
  }
}

void FacingPlanes::add_family(const AcousticScene& scene, const Pair& pair, glm::dvec3 listener, std::span<const std::uint32_t> sides,
                              EnergyHistogram& histogram) const {
  Family family(scene, pair, sides, source_.position, listener);
  if (!family.find_line_across() || !family.average_side_factors() || !family.average_end_factors()) return;
  ImageDeposit deposit(scene, emission_, histogram);
  for (const int way : {-1, 1}) family.add_row(way, least_bounces_, deposit);
}

bool FacingPlanes::Family::find_line_across() {
  glm::dvec3 image(source_);
  for (std::size_t i = 0; i < num_sides(); ++i) image = side(i).mirror(image);
  across_ = flat(image - listener_);
  departure_ = -across_;
  corner_[0] = listener_;
  for (std::size_t i = num_sides(), c = 1; i-- > 0; ++c) {
    const ExactPlane plane = side(i);
    const glm::dvec3 start = corner_[c - 1];
    const double start_height = plane.height(start), image_height = plane.height(image);
    if (!(start_height * image_height < 0)) return false;
    corner_[c] = start + start_height / (start_height - image_height) * (image - start);
    image = plane.mirror(image);
    departure_ = plane.mirror_vector(departure_);
  }
  corner_[num_sides() + 1] = glm::dvec3(source_);
  for (std::size_t c = 1; c <= num_sides() + 1; ++c) along_m_[c] = along_m_[c - 1] + glm::length(flat(corner_[c] - corner_[c - 1]));
  return true;
}

FacingPlanes::Family::LineStatus FacingPlanes::Family::trace_line(double height_m, BandFactors& product) {
  product.fill(1.0);
  for (std::size_t c = 0; c <= num_sides(); ++c) {
    const glm::dvec3 from = at(corner_[c], height_m), to = at(corner_[c + 1], height_m);
    const double length_m = glm::length(to - from);
    // Straight above each other: a line and no strip.  Through the edge of two planes: of no measure.
    if (length_m < 1e-6 * scene_.diagonal_m()) return num_sides() == 0 ? LineStatus::whole : LineStatus::degenerate;
    const glm::vec3 direction((to - from) / length_m);
    const glm::vec3 origin = c == 0 ? glm::vec3(from) : offset_from_surface(glm::vec3(from), direction);
    const Hit hit = scene_.scene().rays().intersect(origin, direction);
    if (c == num_sides()) {
      free_ = free_ && (!hit.valid() || hit.distance_m > length_m * (1 - 1e-4));
      break;
    }
    if (!hit.valid() || scene_.plane_of_triangle()[hit.triangle] != sides_[num_sides() - 1 - c]) {
      free_ = false;
      return LineStatus::broken;
    }
    const std::uint32_t material = scene_.scene().mesh().triangle_material[hit.triangle];
    for (int b = 0; b < scene_.num_bands(); ++b) product[static_cast<std::size_t>(b)] *= specular_fraction(scene_, material, b);
  }
  return LineStatus::whole;
}

bool FacingPlanes::Family::average_side_factors() {
  side_factor_.fill(num_sides() > 0 ? 0.0 : 1.0);
  int levels_found = 0;
  for (int level = 0; level < kLevels; ++level) {
    BandFactors product;
    const LineStatus status = trace_line(pair_.gap_m * (level + 0.5) / kLevels, product);
    if (status == LineStatus::degenerate) return false;
    if (status == LineStatus::broken || num_sides() == 0) continue;
    ++levels_found;
    for (int b = 0; b < scene_.num_bands(); ++b) side_factor_[static_cast<std::size_t>(b)] += product[static_cast<std::size_t>(b)];
  }
  for (double& fraction : side_factor_) fraction /= std::max(levels_found, 1);
  return true;
}

glm::dvec3 FacingPlanes::Family::place_on_line(double to_go_m) const {
  std::size_t c = 1;
  while (c < num_sides() + 1 && along_m_[c] < to_go_m) ++c;
  const double part_m = along_m_[c] - along_m_[c - 1];
  return corner_[c - 1] + (part_m > 0 ? (to_go_m - along_m_[c - 1]) / part_m : 0.0) * (corner_[c] - corner_[c - 1]);
}

bool FacingPlanes::Family::average_end_factors() {
  const double whole_m = along_m_[num_sides() + 1];
  std::array<BandFactors, 2> log_sum{};
  int found = 0;
  const int samples = std::clamp(static_cast<int>(std::ceil(whole_m / kStepM)), kAcross, kMaxAcross);
  for (int k = 0; k < samples; ++k) {
    const glm::dvec3 place = place_on_line(whole_m * (k + 0.5) / samples);
    std::array<std::uint32_t, 2> material{};
    if (!look_across(scene_, at(place, 0), pair_.axis, pair_.gap_m, pair_.plane[1], material[1]) ||
        !look_across(scene_, at(place, pair_.gap_m), -pair_.axis, pair_.gap_m, pair_.plane[0], material[0])) {
      free_ = false;
      continue;
    }
    ++found;
    for (std::size_t end = 0; end < 2; ++end)
      for (int b = 0; b < scene_.num_bands(); ++b)
        log_sum[end][static_cast<std::size_t>(b)] += std::log(std::max(specular_fraction(scene_, material[end], b), 1e-30));
    if (whole_m == 0) break;  // one point
  }
  if (found == 0) return false;
  for (std::size_t end = 0; end < 2; ++end)
    for (int b = 0; b < scene_.num_bands(); ++b)
      end_factor_[end][static_cast<std::size_t>(b)] = std::exp(log_sum[end][static_cast<std::size_t>(b)] / found);
  return true;
}

bool FacingPlanes::Family::follow(int bounces, double rise_m, BandFactors& energy) const {
  const EmbreeScene& rays = scene_.scene().rays();
  energy.fill(1.0);
  glm::vec3 origin(listener_), direction(glm::normalize(across_ + rise_m * pair_.axis));
  const double length_m = std::sqrt(glm::dot(across_, across_) + rise_m * rise_m);
  int ends = 0;
  std::size_t sides_left = num_sides();
  for (int event = 0; event < bounces + static_cast<int>(num_sides()); ++event) {
    const Hit hit = rays.intersect(origin, direction);
    if (!hit.valid()) return false;
    const std::uint32_t plane = scene_.plane_of_triangle()[hit.triangle];
    if (plane == pair_.plane[0] || plane == pair_.plane[1]) {
      if (++ends > bounces) return false;
    } else if (sides_left == 0 || plane != sides_[--sides_left]) {
      return false;
    }
    for (int b = 0; b < scene_.num_bands(); ++b)
      energy[static_cast<std::size_t>(b)] *= specular_fraction(scene_, scene_.scene().mesh().triangle_material[hit.triangle], b);
    origin = offset_from_surface(hit.position, hit.normal);
    direction = mirror_direction(direction, hit.normal);
  }
  // The direction is right by its image; rounding over so few bounces stays below this.
  const glm::vec3 to_source = source_ - origin;
  const float along_m = glm::dot(to_source, direction);
  const glm::vec3 miss = to_source - along_m * direction;
  return along_m > 0 && glm::dot(miss, miss) < 1e-6 * length_m * length_m && !rays.occluded(origin, source_);
}

bool FacingPlanes::Family::sample_run(int way, int n, RunSample& run) const {
  const int size = std::max(4, n / 4), early = n + size / 4, late = early + ((size / 2 - 1) | 1);
  BandFactors traced;
  run.end = n + size - 1;
  run.passing = 0;
  for (const int bounces : {early, late}) run.passing += follow(bounces, rise_of(way, bounces), traced) ? 0.5 : 0.0;
  run.blocked_runs = run.passing > 0 ? 0 : run.blocked_runs + 1;
  return run.blocked_runs < 2;
}

void FacingPlanes::Family::add_row(int way, int least_bounces, ImageDeposit& deposit) const {
  const int num_bands = scene_.num_bands();
  const double across2 = glm::dot(across_, across_);
  BandFactors energy = side_factor_, traced;
  RunSample run;
  for (int n = 1; n <= 0xFFFF; ++n) {
    const bool at_far = (n % 2 == 1) == (way == 1);
    double most = 0;
    for (int b = 0; b < num_bands; ++b) {
      const auto i = static_cast<std::size_t>(b);
      most = std::max(most, energy[i] *= end_factor_[at_far ? 1 : 0][i]);
    }
    if (most < kSpentFraction && (free_ || n > kTracedBounces)) break;
    if (n < least_bounces) continue;
    const double rise_m = rise_of(way, n);
    const double distance_m = std::sqrt(across2 + rise_m * rise_m);
    if (distance_m > scene_.max_path_m()) break;
    const bool one_by_one = !free_ && n <= kTracedBounces;
    if (one_by_one && !follow(n, rise_m, traced)) continue;
    if (!free_ && n > run.end && !sample_run(way, n, run)) break;
    if (!(run.passing > 0)) continue;
    BandFactors kept = one_by_one ? traced : energy;
    for (int b = 0; b < num_bands; ++b) kept[static_cast<std::size_t>(b)] *= run.passing;
    const double departing_m = n % 2 == 0 ? -rise_m : rise_m;
    deposit.add(kept, distance_m, (across_ + rise_m * pair_.axis) / distance_m, (departure_ + departing_m * pair_.axis) / distance_m);
  }
}

}  // namespace earshot
