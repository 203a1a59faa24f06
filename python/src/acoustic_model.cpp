#include "python/src/acoustic_model.h"

#include <fmt/format.h>

#include <algorithm>
#include <atomic>
#include <cmath>
#include <exception>
#include <functional>
#include <numbers>
#include <thread>

#include "envs/episodes/episode_generator.h"
#include "sim/acoustics/source_field/field_for_poses.h"
#include "sim/base/errors.h"
#include "sim/base/random.h"
#include "sim/base/text/config_reader.h"
#include "sim/nav/navmesh.h"
#include "sim/scene/checks/scene_check.h"

namespace earshot::python {
namespace {

constexpr double kDegree = std::numbers::pi / 180;
/// The late field carries harmonics up to here.
constexpr int kTracedOrder = 5;

glm::quat source_orientation(double heading_deg, double pitch_deg) {
  return glm::angleAxis(static_cast<float>(heading_deg * kDegree), glm::vec3(0, 1, 0)) *
         glm::angleAxis(static_cast<float>(pitch_deg * kDegree), glm::vec3(1, 0, 0));
}

void require_finite(glm::dvec3 position, const char* key) {
  for (int axis = 0; axis < 3; ++axis) require(std::isfinite(position[axis]), key, position[axis], "must be finite");
}

/// make(thread) gives each thread what it works with: a function of the index.  The first exception comes back to the caller.
template <class Make>
void for_each(std::size_t count, int threads, const Make& make) {
  const unsigned cores = std::max(1u, std::thread::hardware_concurrency());
  const std::size_t wanted = threads > 0 ? static_cast<std::size_t>(threads) : cores;
  std::atomic<std::size_t> next{0};
  std::exception_ptr error;
  std::mutex error_mutex;
  const auto work = [&] {
    try {
      auto one = make();
      for (std::size_t i = next++; i < count; i = next++) one(i);
    } catch (...) {
      next = count;
      const std::lock_guard lock(error_mutex);
      if (!error) error = std::current_exception();
    }
  };
  std::vector<std::thread> helpers;
  for (std::size_t i = 1; i < std::min(wanted, count); ++i) helpers.emplace_back(work);
  work();
  for (std::thread& helper : helpers) helper.join();
  if (error) std::rethrow_exception(error);
}

Rir synthesize(RirSynthesizer& synthesizer, const SourceParts& parts, const ListenerOrientation& orientation, glm::vec3 listener,
               const EnergyResponse& response) {
  Rir rir;
  synthesizer.render(response, orientation, {carrier_key(parts.acoustics->hash(), parts.candidates->source()), listener}, rir);
  return rir;
}

}  // namespace

SceneModel::SceneModel(const std::string& spec, const std::string& preset, const std::vector<std::string>& settings,
                       std::optional<double> rate_hz, std::optional<std::uint64_t> seed, const SceneOverrides& overrides)
    : config_(acoustic_preset(preset)) {
  ConfigReader reader = ConfigReader::from_text("", "settings", settings);
  read(reader, config_);
  reader.finish();
  if (rate_hz) config_.sample_rate_hz = static_cast<float>(*rate_hz);
  if (seed) config_.seed = *seed;
  validate(config_);
  scene_ = std::make_shared<const Scene>(load_scene(spec, overrides));
  warnings_ = scene_warnings(*scene_);
}

std::vector<std::string> SceneModel::warnings() const {
  const std::lock_guard lock(mutex_);
  return warnings_;
}

void SceneModel::add_warnings(const std::vector<std::string>& lines) {
  const std::lock_guard lock(mutex_);
  for (const std::string& line : lines)
    if (std::ranges::find(warnings_, line) == warnings_.end()) warnings_.push_back(line);
}

int SceneModel::harmonics_of(const ListenerLayout& layout) const {
  if (layout.kind == ListenerKind::mono) return 0;  // it hears from all sides alike
  if (layout.kind == ListenerKind::ambisonics) return std::clamp(layout.order, config_.sh_order, kTracedOrder);
  return config_.sh_order;
}

std::shared_ptr<const AcousticScene> SceneModel::acoustics(int sh_order) {
  const std::lock_guard lock(mutex_);
  std::shared_ptr<const AcousticScene>& kept = acoustics_[sh_order];
  if (!kept) {
    AcousticConfig config = config_;
    config.sh_order = sh_order;
    kept = std::make_shared<const AcousticScene>(scene_, config);
  }
  return kept;
}

std::shared_ptr<const SynthesisTables> SceneModel::tables(const std::string& channels, const std::string& hrtf) {
  const ListenerLayout layout = ListenerLayout::named(channels);
  if (!hrtf.empty() && layout.kind != ListenerKind::binaural)
    throw InputError("hrtf", fmt::format("has no effect on channels '{}'", channels), "leave it out, or ask for binaural");
  const std::shared_ptr<const AcousticScene> scene = acoustics(harmonics_of(layout));
  const std::lock_guard lock(mutex_);
  std::shared_ptr<const SynthesisTables>& kept = tables_[{channels, hrtf}];
  if (!kept) {
    std::shared_ptr<const Hrtf> head;
    if (layout.kind == ListenerKind::binaural)
      head = hrtf.empty() ? Hrtf::rigid_sphere(config_.sample_rate_hz) : Hrtf::from_sofa(hrtf, config_.sample_rate_hz);
    kept = make_synthesis_tables(scene->config(), scene->bands(), layout, head);
  }
  return kept;
}

ListenerOrientation ListenerPose::orientation() const {
  require(std::isfinite(heading_deg), "heading_deg", heading_deg, "must be finite");
  require(std::isfinite(pitch_deg), "pitch_deg", pitch_deg, "must be finite");
  require(std::isfinite(roll_deg), "roll_deg", roll_deg, "must be finite");
  // A level listener has a path of its own that keeps the bits of `earshot rir`.
  if (pitch_deg == 0 && roll_deg == 0) return {heading_deg * kDegree};
  return {heading_deg * kDegree, pitch_deg * kDegree, roll_deg * kDegree};
}

SourceModel::SourceModel(std::shared_ptr<SceneModel> scene, glm::dvec3 position, const std::string& pattern, double heading_deg,
                         double pitch_deg, double radius_m)
    : scene_(std::move(scene)), source_(glm::vec3(0)) {
  require_finite(position, "position");
  require(std::isfinite(heading_deg), "heading_deg", heading_deg, "must be finite");
  require(std::isfinite(pitch_deg), "pitch_deg", pitch_deg, "must be finite");
  require(radius_m >= 0 && radius_m <= 10, "radius_m", radius_m, "must be in [0, 10] m");
  source_.position = scene_->scene().to_local(position);
  source_.directivity = Directivity::named(pattern);
  source_.orientation = source_orientation(heading_deg, pitch_deg);
  source_.radius_m = static_cast<float>(radius_m);
}

SourceParts SourceModel::parts(int sh_order, std::size_t responses) {
  const std::lock_guard lock(mutex_);
  SourceParts& kept = parts_[sh_order];
  if (!kept.candidates) {
    kept.acoustics = scene_->acoustics(sh_order);
    kept.candidates = std::make_shared<const EarlyCandidates>(*kept.acoustics, source_);
  }
  if (!kept.field) kept.field = field_for_poses(*kept.acoustics, *kept.candidates, responses);
  return kept;
}

void SourceModel::check_places(std::shared_ptr<const AcousticScene> acoustics, std::span<const ListenerPose> listeners) {
  {
    const std::lock_guard lock(mutex_);
    if (!places_) {
      checked_ = std::move(acoustics);
      places_.emplace(*checked_);
    }
  }
  for (const ListenerPose& pose : listeners)
    scene_->add_warnings(places_->check({"source", source_.position}, {"listener", scene_->scene().to_local(pose.position)}));
}

std::vector<ResponseModel> SourceModel::respond(std::span<const ListenerPose> listeners, const std::string& channels, int threads) {
  for (const ListenerPose& pose : listeners) require_finite(pose.position, "listener");
  const int harmonics = scene_->harmonics_of(ListenerLayout::named(channels));
  check_places(scene_->acoustics(harmonics), listeners);
  const SourceParts shared = parts(harmonics, listeners.size());
  std::vector<ResponseModel> responses(listeners.size());
  for_each(listeners.size(), threads, [&] {
    return [&](std::size_t i) {
      ResponseModel& one = responses[i];
      one.scene = scene_;
      one.parts = shared;
      one.listener = scene_->scene().to_local(listeners[i].position);
      compute_energy_response(*shared.acoustics, *shared.candidates, shared.field.get(), one.listener, one.response);
    };
  });
  return responses;
}

std::vector<Rir> SourceModel::render(std::span<const ListenerPose> listeners, const std::string& channels, const std::string& hrtf,
                                     int threads) {
  for (const ListenerPose& pose : listeners) {
    require_finite(pose.position, "listener");
    (void)pose.orientation();  // before any work
  }
  const int harmonics = scene_->harmonics_of(ListenerLayout::named(channels));
  check_places(scene_->acoustics(harmonics), listeners);
  const SourceParts shared = parts(harmonics, listeners.size());
  const std::shared_ptr<const SynthesisTables> synthesis = scene_->tables(channels, hrtf);
  std::vector<Rir> rirs(listeners.size());
  for_each(listeners.size(), threads, [&] {
    return [&, synthesizer = std::make_shared<RirSynthesizer>(synthesis), response = std::make_shared<EnergyResponse>()](std::size_t i) {
      const glm::vec3 place = scene_->scene().to_local(listeners[i].position);
      compute_energy_response(*shared.acoustics, *shared.candidates, shared.field.get(), place, *response);
      rirs[i] = synthesize(*synthesizer, shared, listeners[i].orientation(), place, *response);
    };
  });
  return rirs;
}

AccuracyPlan SourceModel::plan_accuracy(const std::string& target, std::span<const ListenerPose> listeners, double responses) {
  require(!listeners.empty(), "listeners", listeners.size(), "must be at least one: errors are those at places");
  require(responses > 0 && responses <= 1e12, "responses", responses, "must be in (0, 1e12]");
  std::vector<glm::vec3> places;
  for (const ListenerPose& pose : listeners) {
    require_finite(pose.position, "listeners");
    places.push_back(scene_->scene().to_local(pose.position));
  }
  return earshot::plan_accuracy(*scene_->acoustics(scene_->config().sh_order), AccuracyTarget::parse(target), source_, std::move(places),
                                responses);
}

Rir render(const ResponseModel& response, const ListenerPose& pose, const std::string& channels, const std::string& hrtf) {
  const int wanted = response.scene->harmonics_of(ListenerLayout::named(channels));
  const int have = response.parts.acoustics->config().sh_order;
  if (wanted > have)
    throw InputError("channels", fmt::format("'{}' needs harmonics of order {}, the response has order {}", channels, wanted, have),
                     "ask for the response with these channels");
  RirSynthesizer synthesizer(response.scene->tables(channels, hrtf));
  return synthesize(synthesizer, response.parts, pose.orientation(), response.listener, response.response);
}

std::vector<glm::dvec3> random_positions(const Scene& scene, int count, double height_m, std::uint64_t seed) {
  require(count >= 0 && count <= 1'000'000, "count", count, "must be in [0, 1000000]");
  require(height_m > 0 && height_m <= 10, "height_m", height_m, "must be in (0, 10] m");
  constexpr std::uint32_t tries = 1000;
  const Navmesh navmesh(scene.mesh(), NavmeshConfig{});
  std::vector<glm::dvec3> positions;
  for (int i = 0; i < count; ++i) {
    const RandomStream random(seed, Purpose::episode, static_cast<std::uint32_t>(i));
    bool found = false;
    for (std::uint32_t draw = 0; draw < tries && !found; ++draw) {
      const glm::vec3 foot = navmesh.random_point(random, 2 * draw);
      found = stands_free(scene, foot, static_cast<float>(height_m));
      if (found) positions.push_back(scene.to_world(foot + glm::vec3(0, static_cast<float>(height_m), 0)));
    }
    if (!found)
      throw InputError(scene.name(), fmt::format("has no free place of {} m height within {} draws", height_m, tries),
                       "lower height_m, or choose places by hand");
  }
  return positions;
}

}  // namespace earshot::python
