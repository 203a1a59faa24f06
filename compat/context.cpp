// SPDX-License-Identifier: Apache-2.0
#include "compat/context.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <glm/geometric.hpp>
#include <utility>

#include "compat/call_error.h"
#include "sim/acoustics/synthesis/channel_order.h"
#include "sim/audio/head/hrtf.h"
#include "sim/base/coordinates.h"
#include "sim/base/errors.h"
#include "sim/scene/checks/scene_check.h"

namespace earshot::compat {
namespace {

constexpr double kLargestRadiusM = 10;
/// `auto` ends here: a scene that needs more has the length that the caller allows.
constexpr float kLongestAutoRirS = 4.f;

template <class Item>
Item& item_at(std::vector<Item>& items, std::size_t index, const char* kind) {
  check(index < items.size(), fmt::format("{} {} of {}; add it first", kind, index, items.size()));
  return items[index];
}

double radius_m(double units, double unit_m) {
  const double radius = units * unit_m;
  check(radius >= 0 && radius <= kLargestRadiusM, fmt::format("a radius of {} m is outside [0, {}]", radius, kLargestRadiusM));
  return radius;
}

glm::dquat unit_quaternion(glm::dquat orientation) {
  const double length = glm::length(orientation);
  check(std::isfinite(length) && length > 1e-9, "a quaternion is zero or not finite; give w, x, y, z");
  return std::abs(length - 1) < 1e-12 ? orientation : orientation / length;
}

/// Of a code of the C interface; the channel count decides for ambisonics alone.
ListenerLayout layout_of(const RLRA_ChannelLayout& layout) {
  const char* name = nullptr;
  switch (static_cast<int>(layout.type)) {
    case RLRA_Layout_Mono:
      return ChannelLayout::mono;
    case RLRA_Layout_Binaural:
      return ChannelLayout::binaural;
    case RLRA_Layout_Ambisonics: {
      const auto order =
          static_cast<int>(std::lround(std::sqrt(static_cast<double>(std::min<std::size_t>(layout.channelCount, 1000))))) - 1;
      check(order >= 0 && order <= 9 && static_cast<std::size_t>((order + 1) * (order + 1)) == layout.channelCount,
            fmt::format("{} ambisonic channels; give (order + 1)^2 for an order from 0 to 9", std::size_t{layout.channelCount}));
      return ListenerLayout::ambisonics(order);
    }
    case RLRA_Layout_Stereo:
      name = "stereo";
      break;
    case RLRA_Layout_Quad:
      name = "quad";
      break;
    case RLRA_Layout_Surround51:
      name = "surround_5_1";
      break;
    case RLRA_Layout_Surround71:
      name = "surround_7_1";
      break;
    default:
      break;
  }
  check(name != nullptr, fmt::format("{} is no channel layout", static_cast<int>(layout.type)));
  try {
    return ListenerLayout::named(name);
  } catch (const InputError& error) {
    throw CallError(RLRA_Unsupported, error.what());
  }
}

}  // namespace

Context::Context(const RLRA_ContextConfiguration& configuration) : Context(read_configuration(configuration, read_environment()), {}) {}

Context::Context(ContextSettings settings, std::set<std::string> lines) : settings_(std::move(settings)), lines_(std::move(lines)) {
  for (const std::string& warning : settings_.warnings) warn_once(warning);
}

void Context::reset(const RLRA_ContextConfiguration& configuration) {
  ContextSettings settings = read_configuration(configuration, read_environment());
  *this = Context(std::move(settings), std::move(lines_));
}

void Context::clear_sources() {
  sources_.clear();
  renderer_.clear_trajectories();
}

void Context::clear_listeners() {
  listeners_.clear();
  renderer_.clear_trajectories();
}

void Context::clear_objects() {
  objects_.clear();
  invalidate_scene();
}

glm::dvec3 Context::place_of(glm::dvec3 units) const {
  const glm::dvec3 place = settings_.unit_m * units;
  check(is_valid_position(place), fmt::format("the position {},{},{} is not finite or too far away", units.x, units.y, units.z));
  return place;
}

void Context::set_source_position(std::size_t source, glm::dvec3 units) {
  PlacedSource& placed = item_at(sources_, source, "source");
  const glm::dvec3 position = place_of(units);
  if (position != placed.position) placed.paths.clear();
  placed.position = position;
}

void Context::set_source_radius(std::size_t source, double units) {
  PlacedSource& placed = item_at(sources_, source, "source");
  const auto radius = static_cast<float>(radius_m(units, settings_.unit_m));
  if (radius != placed.radius_m) placed.paths.clear();
  placed.radius_m = radius;
}

void Context::add_listener(const RLRA_ChannelLayout& layout) { listeners_.push_back({.layout = layout_of(layout)}); }

void Context::set_listener_position(std::size_t listener, glm::dvec3 units) {
  item_at(listeners_, listener, "listener").position = place_of(units);
}

void Context::set_listener_orientation(std::size_t listener, glm::dquat orientation) {
  item_at(listeners_, listener, "listener").orientation = unit_quaternion(orientation);
}

void Context::set_listener_radius(std::size_t listener, double units) {
  (void)item_at(listeners_, listener, "listener");
  (void)radius_m(units, settings_.unit_m);
}

void Context::set_listener_hrtf(std::size_t listener, const std::string& sofa) {
  PlacedListener& placed = item_at(listeners_, listener, "listener");
  if (placed.layout.kind != ListenerKind::binaural)
    throw CallError(RLRA_Unsupported, fmt::format("listener {} is not binaural and takes no HRTF", listener));
  placed.hrtf = sofa.empty() ? nullptr : Hrtf::from_sofa(sofa, settings_.acoustics.sample_rate_hz);
  placed.synthesizer = nullptr;
}

SceneObject& Context::object(std::size_t index) { return item_at(objects_, index, "object"); }

void Context::add_object() { objects_.emplace_back(); }

void Context::set_object_position(std::size_t index, glm::dvec3 units) {
  SceneObject& placed = object(index);
  (void)place_of(units);
  if (placed.position == units) return;
  placed.position = units;
  if (!placed.mesh.empty()) invalidate_scene();
}

void Context::set_object_orientation(std::size_t index, glm::dquat orientation) {
  SceneObject& placed = object(index);
  const glm::dquat unit = unit_quaternion(orientation);
  if (placed.orientation == unit) return;
  placed.orientation = unit;
  if (!placed.mesh.empty()) invalidate_scene();
}

void Context::set_object_mesh(std::size_t index, ObjectMesh mesh) {
  object(index).mesh = std::move(mesh);
  invalidate_scene();
}

void Context::finalize_object_mesh(std::size_t index) {
  ObjectMesh mesh = staging_.take();
  set_object_mesh(index, std::move(mesh));
}

void Context::set_material_database(const std::filesystem::path& path) {
  std::vector<MaterialWarning> warnings;
  database_ = MaterialDatabase::from_file(path, &warnings);
  for (const MaterialWarning& warning : warnings) warn_once(fmt::format("{}: {}: {}", path.string(), warning.material, warning.text));
  invalidate_scene();
}

void Context::invalidate_scene() {
  is_scene_known_ = false;
  scene_ = nullptr;
  acoustics_.clear();
  for (PlacedSource& source : sources_) source.paths.clear();
}

const std::shared_ptr<const Scene>& Context::scene() {
  if (is_scene_known_) return scene_;
  scene_ =
      make_scene(objects_, {.unit_m = settings_.unit_m, .simplify_m = settings_.simplify_m, .database = database_ ? &*database_ : nullptr});
  is_scene_known_ = true;
  if (!scene_) return scene_;
  for (const std::string& warning : scene_->import_report().warnings) warn_once(warning);
  for (const std::string& warning : scene_warnings(*scene_)) warn_once(warning);
  return scene_;
}

std::string Context::obj_text() { return scene_obj(scene().get()); }

AcousticScene Context::plan(std::shared_ptr<const Scene> scene, AcousticConfig config) const {
  config.rir_length_s = 0;
  AcousticScene automatic(scene, config);
  const float needed_s = automatic.config().rir_length_s;
  if (needed_s <= settings_.longest_rir_s && needed_s < kLongestAutoRirS) return automatic;
  config.rir_length_s = settings_.longest_rir_s;
  return {std::move(scene), config};
}

std::shared_ptr<const AcousticScene> Context::acoustics(int sh_order) {
  std::shared_ptr<const AcousticScene>& kept = acoustics_[sh_order];
  if (kept) return kept;
  AcousticConfig config = settings_.acoustics;
  config.sh_order = sh_order;
  std::shared_ptr<const Scene> surfaces = scene();
  if (!surfaces) surfaces = std::make_shared<const Scene>("open air", TriangleMesh{}, std::vector<Material>{}, Air{});
  kept = std::make_shared<const AcousticScene>(plan(std::move(surfaces), config));
  return kept;
}

void Context::simulate() {
  responses_.clear();
  std::vector<PairResponse> responses(listeners_.size() * sources_.size());
  for (std::size_t s = 0; s < sources_.size(); ++s)
    for (std::size_t l = 0; l < listeners_.size(); ++l) {
      PlacedListener& listener = listeners_[l];
      const std::shared_ptr<const AcousticScene> scene = acoustics(harmonics_of(listener.layout, settings_.acoustics));
      PairResponse& pair = responses[l * sources_.size() + s];
      pair = renderer_.render(scene, settings_, sources_[s], listener, {l, s}, listeners_.size());
      pair.rir_arguments = rir_arguments(settings_, scene->config());
      if (pair.is_silent) warn_once(fmt::format("the response is silent: no sound of source {} reaches listener {}", s, l));
      if (pair.num_not_finite > 0)
        warn_once(fmt::format("{} contributions of source {} at listener {} are not finite and were left out", pair.num_not_finite, s, l));
    }
  responses_ = std::move(responses);
  num_simulated_sources_ = sources_.size();
}

const PairResponse* Context::response(std::size_t listener, std::size_t source) const {
  if (responses_.empty() || source >= num_simulated_sources_ || listener >= responses_.size() / num_simulated_sources_) return nullptr;
  return &responses_[listener * num_simulated_sources_ + source];
}

std::string Context::metrics_text(std::size_t listener, std::size_t source) const {
  const PairResponse* pair = response(listener, source);
  check(pair != nullptr, fmt::format("there is no response of listener {} to source {}; simulate first", listener, source));
  const auto text = [](const std::optional<double>& value) { return value ? fmt::format("{:.6g}", *value) : std::string("nan"); };
  std::string lines =
      fmt::format("# listener {}, source {}\n# earshot rir {}\n# drr_db {}\n# direct_delay_s {}\n# ray_efficiency {:.6g}\n", listener,
                  source, pair->rir_arguments, text(pair->metrics.drr_db), text(pair->metrics.direct_delay_s), pair->ray_efficiency);
  lines += "# band_hz rt60_s edt_s drr_db c80_db c50_db d50 ts_s\n";
  for (std::size_t b = 0; b < pair->metrics.bands.size(); ++b) {
    const BandMetrics& band = pair->metrics.bands[b];
    lines += fmt::format("{:.6g}", pair->metrics.bands_hz[b]);
    for (const auto& value : {band.rt60_s, band.edt_s, band.drr_db, band.c80_db, band.c50_db, band.d50, band.ts_s})
      lines += " " + text(value);
    lines += "\n";
  }
  return lines;
}

double Context::ray_efficiency() const {
  if (responses_.empty()) return 0;
  double sum = 0;
  for (const PairResponse& pair : responses_) sum += pair.ray_efficiency;
  return sum / static_cast<double>(responses_.size());
}

void Context::trace(RLRA_Ray& ray) {
  glm::dvec3 origin, direction;
  for (int i = 0; i < 3; ++i) {
    origin[i] = static_cast<double>(ray.origin[i]);
    direction[i] = static_cast<double>(ray.direction[i]);
  }
  const double length = glm::length(direction), least = static_cast<double>(ray.tMin), most = static_cast<double>(ray.tMax);
  check(std::isfinite(length) && length > 0, "the direction of a ray is zero or not finite");
  check(std::isfinite(least) && !std::isnan(most), "an end of a ray is not a number");
  const glm::dvec3 start = place_of(origin + least * direction);
  ray.hit = 0;
  if (!(least < most) || !scene()) return;
  const double m_per_t = length * settings_.unit_m;
  const auto farthest_m = static_cast<float>(std::min((most - least) * m_per_t, 4 * kMaxCoordinateM));
  const Hit hit = scene_->rays().intersect(scene_->to_local(start), glm::vec3(direction / length), farthest_m);
  if (!hit.valid()) return;
  const glm::uvec3 corners = scene_->mesh().triangles[hit.triangle];
  const glm::dvec3 a = scene_->mesh().vertices[corners.x], b = scene_->mesh().vertices[corners.y], c = scene_->mesh().vertices[corners.z];
  const glm::dvec3 normal = glm::cross(b - a, c - a);
  ray.hit = 1;
  ray.tMax = static_cast<float>(std::clamp(least + static_cast<double>(hit.distance_m) / m_per_t, least, most));
  for (int i = 0; i < 3; ++i) ray.normal[i] = static_cast<float>(normal[i]);
}

void Context::warn_once(const std::string& line) {
  if (lines_.size() >= kMaxLines || !lines_.insert(line).second) return;
  print_line(line + (lines_.size() == kMaxLines ? " (further lines are left out)" : ""));
}

}  // namespace earshot::compat
