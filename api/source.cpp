// SPDX-License-Identifier: Apache-2.0
#include "earshot/source.h"

#include <algorithm>
#include <atomic>
#include <exception>
#include <glm/gtc/quaternion.hpp>
#include <numbers>
#include <system_error>
#include <thread>

#include "api/convert.h"
#include "api/source_model.h"
#include "sim/acoustics/accuracy/accuracy_plan.h"
#include "sim/acoustics/source_field/field_for_poses.h"
#include "sim/base/errors.h"

namespace earshot::api {
namespace {

constexpr double kDegree = std::numbers::pi / 180;
constexpr int kMostThreads = 1024;

glm::quat source_orientation(double heading_deg, double pitch_deg) {
  return glm::angleAxis(static_cast<float>(heading_deg * kDegree), glm::vec3(0, 1, 0)) *
         glm::angleAxis(static_cast<float>(pitch_deg * kDegree), glm::vec3(1, 0, 0));
}

void throw_if_stopped(const std::stop_token& stop) {
  if (stop.stop_requested()) throw RunError("responses", "were stopped by the caller");
}

/// make() gives each thread a function of the index with scratch of its own.  The first exception comes back to the caller.
template <class Make>
void for_each_index(std::size_t count, const BatchOptions& options, const Make& make) {
  require(options.threads >= 0 && options.threads <= kMostThreads, "threads", options.threads, "must be in [0, 1024]");
  const unsigned cores = std::max(1u, std::thread::hardware_concurrency());
  const std::size_t wanted = options.threads > 0 ? static_cast<std::size_t>(options.threads) : cores;
  std::atomic<std::size_t> next{0};
  std::exception_ptr error;
  std::mutex error_mutex;
  const auto work = [&] {
    try {
      auto render_item = make();
      for (std::size_t i = next++; i < count; i = next++) {
        throw_if_stopped(options.stop);
        render_item(i);
      }
    } catch (...) {
      next = count;
      const std::lock_guard lock(error_mutex);
      if (!error) error = std::current_exception();
    }
  };
  {
    std::vector<std::jthread> helpers;
    try {
      for (std::size_t i = 1; i < std::min(wanted, count); ++i) helpers.emplace_back(work);
    } catch (const std::system_error&) {  // the machine has no more threads: those that there are do the work
    }
    work();
  }
  if (error) std::rethrow_exception(error);
}

std::map<std::string, double> errors_by_name(const AccuracyErrors& errors) {
  std::map<std::string, double> named;
  for (std::size_t kind = 0; kind < kNumAccuracyKinds; ++kind) {
    const AccuracyUnit& unit = unit_of(static_cast<AccuracyKind>(kind));
    named[std::string(unit.name) + (unit.scale > 1 ? "_pct" : "_db")] = errors[kind] * unit.scale;
  }
  return named;
}

}  // namespace

Source::Model::Model(std::shared_ptr<Scene::Model> scene, const Vec3& position, const SourceOptions& options)
    : scene_(std::move(scene)), source_(glm::vec3(0)) {
  require_finite(position, "position");
  require(std::isfinite(options.heading_deg), "heading_deg", options.heading_deg, "must be finite");
  require(std::isfinite(options.pitch_deg), "pitch_deg", options.pitch_deg, "must be finite");
  require(options.radius_m >= 0 && options.radius_m <= 10, "radius_m", options.radius_m, "must be in [0, 10] m");
  source_.position = scene_->scene().to_local(glm_of(position));
  source_.directivity = Directivity::named(options.pattern);
  source_.orientation = source_orientation(options.heading_deg, options.pitch_deg);
  source_.radius_m = static_cast<float>(options.radius_m);
}

SourceParts Source::Model::parts(int sh_order, std::size_t responses, const std::stop_token& stop) {
  SourceParts parts{.acoustics = scene_->acoustics(sh_order), .candidates = nullptr, .field = nullptr};
  const AcousticScene& acoustics = *parts.acoustics;
  parts.candidates = candidates_.get(
      sh_order, [&] { return std::make_shared<const EarlyCandidates>(acoustics, source_); }, stop);
  if (wants_source_field(acoustics, responses))
    parts.field = fields_.get(
        sh_order, [&] { return build_source_field(acoustics, *parts.candidates, [&](double) { throw_if_stopped(stop); }); }, stop);
  return parts;
}

void Source::Model::check_places(std::shared_ptr<const AcousticScene> acoustics, std::span<const Vec3> listeners) {
  {
    const std::lock_guard lock(mutex_);
    if (!places_) {
      checked_ = std::move(acoustics);
      places_.emplace(*checked_);
    }
  }
  for (const Vec3& listener : listeners)
    scene_->add_warnings(places_->check({"source", source_.position}, {"listener", scene_->scene().to_local(glm_of(listener))}));
}

Rir Source::render(const Vec3& listener, const RenderOptions& options) const {
  const Listener pose{listener, options.heading_deg, options.pitch_deg, options.roll_deg};
  const std::string channels = options.channels.empty() ? "binaural" : options.channels;
  return std::move(render_all({&pose, 1}, {.channels = channels, .hrtf = options.hrtf, .threads = 1}).front());
}

std::vector<Rir> Source::render_all(std::span<const Listener> listeners, const BatchOptions& options) const {
  std::vector<Vec3> positions;
  for (const Listener& listener : listeners) {
    require_finite(listener.position, "listener");
    (void)orientation_of(listener.heading_deg, listener.pitch_deg, listener.roll_deg);  // before any work
    positions.push_back(listener.position);
  }
  Scene::Model& scene = *model_->scene();
  const int harmonics = scene.harmonics_of(ListenerLayout::named(options.channels));
  model_->check_places(scene.acoustics(harmonics), positions);
  const SourceParts shared = model_->parts(harmonics, listeners.size(), options.stop);
  const std::shared_ptr<const SynthesisTables> synthesis = scene.tables(options.channels, options.hrtf);
  std::vector<Rir> rirs(listeners.size());
  for_each_index(listeners.size(), options, [&] {
    return [&, synthesizer = std::make_shared<RirSynthesizer>(synthesis), response = std::make_shared<EnergyResponse>()](std::size_t i) {
      const Listener& listener = listeners[i];
      const glm::vec3 place = scene.scene().to_local(glm_of(listener.position));
      compute_energy_response(*shared.acoustics, *shared.candidates, shared.field.get(), place, *response);
      rirs[i] =
          synthesize(*synthesizer, shared, orientation_of(listener.heading_deg, listener.pitch_deg, listener.roll_deg), place, *response);
    };
  });
  return rirs;
}

Response Source::response(const Vec3& listener, const std::string& channels) const {
  return std::move(responses({&listener, 1}, {.channels = channels, .threads = 1}).front());
}

std::vector<Response> Source::responses(std::span<const Vec3> listeners, const BatchOptions& options) const {
  for (const Vec3& listener : listeners) require_finite(listener, "listener");
  const std::shared_ptr<Scene::Model>& scene = model_->scene();
  const int harmonics = scene->harmonics_of(ListenerLayout::named(options.channels));
  model_->check_places(scene->acoustics(harmonics), listeners);
  const SourceParts shared = model_->parts(harmonics, listeners.size(), options.stop);
  std::vector<std::shared_ptr<Response::Model>> models(listeners.size());
  for_each_index(listeners.size(), options, [&] {
    return [&](std::size_t i) {
      auto model = std::make_shared<Response::Model>();
      model->scene = scene;
      model->parts = shared;
      model->channels = options.channels;
      model->listener = scene->scene().to_local(glm_of(listeners[i]));
      compute_energy_response(*shared.acoustics, *shared.candidates, shared.field.get(), model->listener, model->response);
      describe_arrivals(*model);
      models[i] = std::move(model);
    };
  });
  std::vector<Response> responses;
  for (auto& model : models) responses.emplace_back(std::move(model));
  return responses;
}

AccuracyPlan Source::plan_accuracy(const std::string& target, std::span<const Vec3> listeners, double responses,
                                   const std::stop_token& stop) const {
  require(!listeners.empty(), "listeners", listeners.size(), "must be at least one: errors are those at places");
  const double wanted = responses == 0 ? static_cast<double>(listeners.size()) : responses;
  require(wanted > 0 && wanted <= 1e12, "responses", wanted, "must be in (0, 1e12]");
  Scene::Model& scene = *model_->scene();
  std::vector<glm::vec3> places;
  for (const Vec3& listener : listeners) {
    require_finite(listener, "listeners");
    places.push_back(scene.scene().to_local(glm_of(listener)));
  }
  model_->check_places(scene.acoustics(), listeners);
  const earshot::AccuracyPlan found = earshot::plan_accuracy(*scene.acoustics(), AccuracyTarget::parse(target), model_->source(),
                                                             std::move(places), wanted, [&](double) { throw_if_stopped(stop); });
  AccuracyPlan plan;
  for (const earshot::AccuracyChoice& choice : found.tried)
    plan.tried.push_back({.method = choice.method,
                          .settings = Settings(settings_of(choice)),
                          .predicted = errors_by_name(choice.predicted),
                          .per_source_ms = choice.per_source_ms,
                          .per_response_ms = choice.per_pose_ms});
  plan.chosen = found.chosen;
  plan.reference_error = errors_by_name(found.reference_error);
  plan.calibration_s = found.calibration_s;
  return plan;
}

}  // namespace earshot::api
