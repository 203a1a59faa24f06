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
constexpr int kAcross = 12, kMostAcross = 240, kLevels = 4;
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

}  // namespace

/// Paths of one pair and one sequence of side planes at one listener.
struct FacingPlanes::Family {
  glm::dvec3 across{0};                               ///< from the listener to the images, at right angles to the axis
  glm::dvec3 departure{0};                            ///< the same as the sound leaves the source
  std::array<std::array<double, kMaxBands>, 2> ends;  ///< energy fraction of a bounce on either plane
  std::array<double, kMaxBands> sides;                ///< of all side planes together
  bool free = true;                                   ///< nothing stands in the strip
};

FacingPlanes::FacingPlanes(const AcousticScene& scene, const SoundSource& source) : source_(source), emission_(source, scene.bands()) {
  least_bounces_ = static_cast<std::uint16_t>(scene.image_order() + 1);
  // Without image paths mirrors are the tracers' alone.
  if (scene.image_order() > 0) find_pairs(scene);
}

void FacingPlanes::find_pairs(const AcousticScene& scene) {
  const EmbreeScene& rays = scene.scene().rays();
  const DiffuseDecay decay(scene, source_.position);
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
    if (pair.plane[0] == pair.plane[1]) continue;
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
    find_sides(scene, pair);
    pairs_.push_back(std::move(pair));
  }
}

void FacingPlanes::find_sides(const AcousticScene& scene, Pair& pair) const {
  const std::span<const MirrorPlane> planes = scene.planes();
  pair.role.assign(planes.size(), kNone);
  for (std::uint32_t p = 0; p < planes.size() && pair.side.size() < kMaxSidePlanes; ++p) {
    if (std::abs(glm::dot(ExactPlane(planes[p]).normal, pair.axis)) > FacingPlanes::kParallelSine) continue;
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
  add_family(scene, pair, listener, sides, num_sides, histogram);
  if (num_sides == pair.max_sides) return;
  for (const std::uint32_t plane : pair.side) {
    if (num_sides > 0 && sides[static_cast<std::size_t>(num_sides) - 1] == plane) continue;
    sides[static_cast<std::size_t>(num_sides)] = plane;
    add_families(scene, pair, listener, sides, num_sides + 1, histogram);
  }
}

void FacingPlanes::add_family(const AcousticScene& scene, const Pair& pair, glm::dvec3 listener, const Sequence& sides, int num_sides,
                              EnergyHistogram& histogram) const {
  const EmbreeScene& rays = scene.scene().rays();
  const int num_bands = scene.num_bands();
  const glm::dvec3 source(source_.position);
  const double source_m = glm::dot(pair.axis, source) - pair.offset_m, listener_m = glm::dot(pair.axis, listener) - pair.offset_m;
  const auto flat = [&](glm::dvec3 v) { return v - glm::dot(pair.axis, v) * pair.axis; };
  // A point of the strip: by its place across, at a height over plane 0.
  const auto at = [&](glm::dvec3 point, double height_m) { return flat(point) + (pair.offset_m + height_m) * pair.axis; };

  // The line across, from the listener to the source: as in EarlyCandidates::find_path, seen along the axis.
  glm::dvec3 image = source;
  for (int i = 0; i < num_sides; ++i) image = ExactPlane(scene.planes()[sides[static_cast<std::size_t>(i)]]).mirror(image);
  Family family;
  family.across = flat(image - listener);
  family.departure = -family.across;
  std::array<glm::dvec3, kMaxSides + 2> corner;
  corner[0] = listener;
  for (int i = num_sides - 1, c = 1; i >= 0; --i, ++c) {
    const ExactPlane plane(scene.planes()[sides[static_cast<std::size_t>(i)]]);
    const glm::dvec3 start = corner[static_cast<std::size_t>(c) - 1];
    const double here = plane.height(start), there = plane.height(image);
    if (!(here * there < 0)) return;
    corner[static_cast<std::size_t>(c)] = start + here / (here - there) * (image - start);
    image = plane.mirror(image);
    family.departure = plane.mirror_vector(family.departure);
  }
  corner[static_cast<std::size_t>(num_sides) + 1] = source;

  // Side planes must be there over the whole height, and nothing before them.
  family.sides.fill(num_sides > 0 ? 0.0 : 1.0);
  int levels_found = 0;
  for (int level = 0; level < kLevels; ++level) {
    const double height_m = pair.gap_m * (level + 0.5) / kLevels;
    std::array<double, kMaxBands> product;
    product.fill(1.0);
    bool whole = true;
    for (int c = 0; c <= num_sides; ++c) {
      const glm::dvec3 from = at(corner[static_cast<std::size_t>(c)], height_m), to = at(corner[static_cast<std::size_t>(c) + 1], height_m);
      const double length_m = glm::length(to - from);
      if (length_m < 1e-6 * scene.diagonal_m()) {
        if (num_sides == 0) break;  // straight above each other: a line and no strip
        return;                     // through the edge of two planes: of no measure
      }
      const glm::vec3 direction((to - from) / length_m);
      const glm::vec3 origin = c == 0 ? glm::vec3(from) : offset_from_surface(glm::vec3(from), direction);
      const Hit hit = rays.intersect(origin, direction);
      if (c == num_sides) {
        family.free = family.free && (!hit.valid() || hit.distance_m > length_m * (1 - 1e-4));
        break;
      }
      const std::uint32_t plane = sides[static_cast<std::size_t>(num_sides - 1 - c)];
      if (!hit.valid() || scene.plane_of_triangle()[hit.triangle] != plane) {
        family.free = whole = false;
        break;
      }
      const std::uint32_t material = scene.scene().mesh().triangle_material[hit.triangle];
      for (int b = 0; b < num_bands; ++b) product[static_cast<std::size_t>(b)] *= specular_fraction(scene, material, b);
    }
    if (!whole || num_sides == 0) continue;
    ++levels_found;
    for (int b = 0; b < num_bands; ++b) family.sides[static_cast<std::size_t>(b)] += product[static_cast<std::size_t>(b)];
  }
  for (double& fraction : family.sides) fraction /= std::max(levels_found, 1);

  // Both planes along that line, and nothing between them.
  std::array<double, kMaxSides + 2> along{};
  for (int c = 1; c <= num_sides + 1; ++c) {
    const auto i = static_cast<std::size_t>(c);
    along[i] = along[i - 1] + glm::length(flat(corner[i] - corner[i - 1]));
  }
  const double whole_m = along[static_cast<std::size_t>(num_sides) + 1];
  std::array<std::array<double, kMaxBands>, 2> log_sum{};
  int found = 0;
  const int samples = std::clamp(static_cast<int>(std::ceil(whole_m / kStepM)), kAcross, kMostAcross);
  for (int k = 0; k < samples; ++k) {
    const double to_go_m = whole_m * (k + 0.5) / samples;
    std::size_t c = 1;
    while (static_cast<int>(c) < num_sides + 1 && along[c] < to_go_m) ++c;
    const double part_m = along[c] - along[c - 1];
    const glm::dvec3 place = corner[c - 1] + (part_m > 0 ? (to_go_m - along[c - 1]) / part_m : 0.0) * (corner[c] - corner[c - 1]);
    std::array<std::uint32_t, 2> material{};
    if (!look_across(scene, at(place, 0), pair.axis, pair.gap_m, pair.plane[1], material[1]) ||
        !look_across(scene, at(place, pair.gap_m), -pair.axis, pair.gap_m, pair.plane[0], material[0])) {
      family.free = false;
      continue;
    }
    ++found;
    for (std::size_t end = 0; end < 2; ++end)
      for (int b = 0; b < num_bands; ++b)
        log_sum[end][static_cast<std::size_t>(b)] += std::log(std::max(specular_fraction(scene, material[end], b), 1e-30));
    if (whole_m == 0) break;  // one point
  }
  if (found == 0) return;
  for (std::size_t end = 0; end < 2; ++end)
    for (int b = 0; b < num_bands; ++b)
      family.ends[end][static_cast<std::size_t>(b)] = std::exp(log_sum[end][static_cast<std::size_t>(b)] / found);

  // The path of `bounces` between the planes whose image lies `rise_m` along the axis: follows it and keeps what it meets.
  const auto follow = [&](int bounces, double rise_m, std::array<double, kMaxBands>& energy) {
    energy.fill(1.0);
    glm::vec3 origin(listener), direction(glm::normalize(family.across + rise_m * pair.axis));
    const double length_m = std::sqrt(glm::dot(family.across, family.across) + rise_m * rise_m);
    int ends = 0, next_side = num_sides - 1;
    for (int event = 0; event < bounces + num_sides; ++event) {
      const Hit hit = rays.intersect(origin, direction);
      if (!hit.valid()) return false;
      const std::uint32_t plane = scene.plane_of_triangle()[hit.triangle];
      if (plane == pair.plane[0] || plane == pair.plane[1]) {
        if (++ends > bounces) return false;
      } else if (next_side < 0 || plane != sides[static_cast<std::size_t>(next_side--)]) {
        return false;
      }
      for (int b = 0; b < num_bands; ++b)
        energy[static_cast<std::size_t>(b)] *= specular_fraction(scene, scene.scene().mesh().triangle_material[hit.triangle], b);
      origin = offset_from_surface(hit.position, hit.normal);
      direction = mirror_direction(direction, hit.normal);
    }
    // The direction is right by its image; rounding over so few bounces stays below this.
    const glm::vec3 to_source = source_.position - origin;
    const float along_m = glm::dot(to_source, direction);
    const glm::vec3 miss = to_source - along_m * direction;
    return along_m > 0 && glm::dot(miss, miss) < 1e-6 * length_m * length_m && !rays.occluded(origin, source_.position);
  };

  ImageDeposit deposit(scene, emission_, histogram);
  const double across2 = glm::dot(family.across, family.across);
  for (const int way : {-1, 1}) {  // plane 0 or plane 1 first, from the listener
    std::array<double, kMaxBands> energy = family.sides, traced;
    const auto rise_of = [&](int n) { return way * n * pair.gap_m + (n % 2 == 0 ? source_m : pair.gap_m - source_m) - listener_m; };
    // Past kTracedBounces, of an obstructed strip: the fraction that comes through is that of two paths out of each run of a quarter more
    // bounces.  What is wide across the strip blocks them all from some length on: the row ends with two runs of which nothing is left.
    int run_end = kTracedBounces, blocked_runs = 0;
    double passing = 1;
    for (int n = 1; n <= 0xFFFF; ++n) {
      const bool at_far = (n % 2 == 1) == (way == 1);
      double most = 0;
      for (int b = 0; b < num_bands; ++b) {
        const auto i = static_cast<std::size_t>(b);
        most = std::max(most, energy[i] *= family.ends[at_far ? 1 : 0][i]);
      }
      if (most < kSpentFraction && (family.free || n > kTracedBounces)) break;
      if (n < least_bounces_) continue;
      const double rise_m = rise_of(n);
      const double distance_m = std::sqrt(across2 + rise_m * rise_m);
      if (distance_m > scene.max_path_m()) break;
      const bool one_by_one = !family.free && n <= kTracedBounces;
      if (one_by_one && !follow(n, rise_m, traced)) continue;
      if (!family.free && n > run_end) {
        const int size = std::max(4, n / 4), early = n + size / 4, late = early + ((size / 2 - 1) | 1);
        run_end = n + size - 1;
        passing = 0;
        for (const int bounces : {early, late}) passing += follow(bounces, rise_of(bounces), traced) ? 0.5 : 0.0;
        blocked_runs = passing > 0 ? 0 : blocked_runs + 1;
        if (blocked_runs == 2) break;
      }
      if (!(passing > 0)) continue;
      std::array<double, kMaxBands> kept = one_by_one ? traced : energy;
      for (int b = 0; b < num_bands; ++b) kept[static_cast<std::size_t>(b)] *= passing;
      const double departing_m = n % 2 == 0 ? -rise_m : rise_m;
      deposit.add(kept, distance_m, (family.across + rise_m * pair.axis) / distance_m,
                  (family.departure + departing_m * pair.axis) / distance_m);
    }
  }
}

}  // namespace earshot
