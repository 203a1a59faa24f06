// SPDX-License-Identifier: Apache-2.0
#include "sim/acoustics/accuracy/accuracy_plan.h"

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <optional>
#include <utility>

#include "sim/acoustics/accuracy/accuracy_search.h"
#include "sim/base/errors.h"
#include "sim/base/stopwatch.h"

namespace earshot {
namespace {

/// Of the target: standard error of the paths in one value, at kMaxPlaces places.  Fewer have fewer values, each known the better.  Half
/// of that where nothing holds, or something far cheaper may, as what the paths are uncertain by is part of what is predicted.
constexpr std::array<double, 2> kReferenceFractions = {0.7, 0.35};
constexpr int kMaxRuns = 1024;
constexpr double kReferencePart = 0.8;  ///< of the time, for the progress line

std::vector<glm::vec3> spread(const std::vector<glm::vec3>& places) {
  const std::size_t count = std::min(places.size(), kMaxPlaces);
  std::vector<glm::vec3> selected;
  for (std::size_t i = 0; i < count; ++i) selected.push_back(places[count == 1 ? 0 : i * (places.size() - 1) / (count - 1)]);
  return selected;
}

std::string scenes_of(const AccuracyRequest& request) {
  std::string names;
  for (const AccuracySite& site : request.sites) names += (names.empty() ? "" : ", ") + site.scene->name();
  return names;
}

/// Paths at every site until they are known to `fraction` of the target.  false: no run was added.
bool refine(const AccuracyRequest& request, double fraction, const std::function<void(double fraction)>& progress,
            std::vector<AccuracyReference>& references, AccuracyPlan& plan) {
  const int before = plan.reference_runs;
  plan.reference_runs = 0;
  plan.reference_error.fill(std::nan(""));
  for (std::size_t site = 0; site < references.size(); ++site) {
    AccuracyReference& reference = references[site];
    const double places = static_cast<double>(reference.places().size()) / kMaxPlaces;
    reference.refine(request.target, fraction * std::sqrt(places), static_cast<int>(kMaxRuns / places), [&](double done) {
      if (progress) progress(kReferencePart * (static_cast<double>(site) + done) / static_cast<double>(references.size()));
    });
    plan.reference_runs += reference.runs();
    for (std::size_t kind = 0; kind < kNumAccuracyKinds; ++kind)
      plan.reference_error[kind] = std::fmax(plan.reference_error[kind], reference.standard_error()[kind]);
  }
  return plan.reference_runs > before;
}

/// Tries everything against these paths; the cheapest that holds, if any.
std::optional<std::size_t> search(const AccuracyRequest& request, std::span<const AccuracyReference> references,
                                  const std::function<void(double fraction)>& progress, std::vector<AccuracyChoice>& tried) {
  tried.clear();
  AccuracySearch search(request, references, tried);
  const bool asks_for_levels = request.target.of(AccuracyKind::drr) || request.target.of(AccuracyKind::edc);
  for (std::size_t early = kUsualEarlyLevel; early < kNumEarlyLevels; ++early) {
    if (early > kUsualEarlyLevel && !asks_for_levels) break;  // decay times do not come from images
    AcousticConfig config = request.config;
    set_early_level(early, config);
    // The field comes first: its cost limits how far the other candidates are refined.
    for (const float cell_m : {1.f, 0.5f}) search.source_field(config, cell_m);
    if (early == kUsualEarlyLevel || !search.best()) {
      search.listener_rays(config);
      search.both_ends(config);
    }
    if (progress) progress(kReferencePart + (1 - kReferencePart) * static_cast<double>(early) / (kNumEarlyLevels - 1));
  }
  search.fewer_images();
  return search.best();
}

void refuse_immeasurable_targets(const AccuracyRequest& request, const AccuracyPlan& plan) {
  for (std::size_t kind = 0; kind < kNumAccuracyKinds; ++kind)
    if (request.target.most[kind] && std::isnan(plan.reference_error[kind]))
      throw InputError("accuracy " + request.target.text(),
                       fmt::format("contains {}, which cannot be measured at any position in {}",
                                   unit_of(static_cast<AccuracyKind>(kind)).name, scenes_of(request)),
                       "leave it out, or increase rir_length_s");
  if (request.target.used(plan.reference_error) > 1)
    throw InputError("accuracy " + request.target.text(),
                     fmt::format("cannot be checked in {}: after {} runs the bidirectional reference has a standard error of {}",
                                 scenes_of(request), plan.reference_runs, text_of(plan.reference_error)),
                     "allow a larger error, or use --preset high");
}

/// May something far cheaper than the best be within the target, which these paths are too uncertain to tell?
bool is_undecided(const AccuracyRequest& request, const std::vector<AccuracyChoice>& tried, const AccuracyChoice& best) {
  constexpr double far_cheaper = 0.5;
  return std::ranges::any_of(tried, [&](const AccuracyChoice& choice) {
    return request.target.used(choice.measured) <= kAccuracyMargin && request.target.used(choice.predicted) > kAccuracyMargin &&
           choice.total_ms(request.poses) < far_cheaper * best.total_ms(request.poses);
  });
}

[[noreturn]] void refuse_unreachable_target(const AccuracyRequest& request, const AccuracyPlan& plan) {
  const auto closest =
      std::ranges::min_element(plan.tried, {}, [&](const AccuracyChoice& choice) { return request.target.used(choice.predicted); });
  const bool too_dear = request.target.used(closest->predicted) <= kAccuracyMargin;
  throw InputError(
      "accuracy " + request.target.text(),
      fmt::format("cannot be met in {}: {}the best of {} candidates, {}, is predicted at {} (standard error of the reference: {})",
                  scenes_of(request), too_dear ? "the time limit is exceeded; " : "", plan.tried.size(), closest->method,
                  text_of(closest->predicted), text_of(plan.reference_error)),
      fmt::format("allow a larger error (predictions must stay below {:.0f} % of it), or use --preset high", 100 * kAccuracyMargin));
}

}  // namespace

std::span<const std::string_view> keys_of_accuracy() {
  static constexpr std::array<std::string_view, 11> keys = {
      "rays",          "source_rays", "source_bounces", "early_order",          "early_candidate_rays",   "field",
      "field_photons", "field_error", "field_cell_m",   "diffuse_last_segment", "diffraction_reflections"};
  return keys;
}

AccuracyPlan plan_accuracy(const AccuracyRequest& request, const std::function<void(double fraction)>& progress) {
  EARSHOT_EXPECT(!request.sites.empty() && request.poses > 0);
  for (const AccuracySite& site : request.sites) EARSHOT_EXPECT(site.scene && !site.places.empty());
  const Stopwatch watch;
  AccuracyPlan plan;
  std::vector<AccuracyReference> references;
  for (const AccuracySite& site : request.sites) references.emplace_back(site.scene, request.config, site.source, spread(site.places));
  std::optional<std::size_t> best;
  for (std::size_t stage = 0; stage < kReferenceFractions.size(); ++stage) {
    const auto of_stage = [&](double done) {
      if (progress) progress((static_cast<double>(stage) + done) / kReferenceFractions.size());
    };
    if (!refine(request, kReferenceFractions[stage], of_stage, references, plan)) break;
    refuse_immeasurable_targets(request, plan);
    best = search(request, references, of_stage, plan.tried);
    if (best && !is_undecided(request, plan.tried, plan.tried[*best])) break;
  }
  plan.calibration_s = watch.wall_s();
  if (!best) refuse_unreachable_target(request, plan);
  plan.chosen = *best;
  if (progress) progress(1);
  return plan;
}

AccuracyPlan plan_accuracy(const AcousticScene& acoustics, const AccuracyTarget& target, const SoundSource& source,
                           std::vector<glm::vec3> places, double poses, const std::function<void(double fraction)>& progress) {
  AccuracyRequest request;
  request.config = acoustics.config();
  request.target = target;
  request.sites.push_back({.scene = acoustics.shared_scene(), .source = source, .places = std::move(places)});
  request.poses = poses;
  return plan_accuracy(request, progress);
}

AcousticScene planned_scene(const AcousticScene& acoustics, const AccuracyPlan& plan) {
  return AcousticScene(acoustics.shared_scene(), plan.choice().config);
}

std::vector<std::string> settings_of(const AccuracyChoice& choice) {
  const AcousticConfig& config = choice.config;
  std::vector<std::string> settings = {fmt::format("rir_length_s={}", config.rir_length_s),
                                       fmt::format("source_radius_m={}", config.source_radius_m),
                                       fmt::format("source_rays={}", config.source_rays),
                                       fmt::format("rays={}", config.rays),
                                       fmt::format("early_order={}", config.early_order),
                                       fmt::format("early_candidate_rays={}", config.early_candidate_rays),
                                       fmt::format("diffraction_reflections={}", config.diffraction_reflections),
                                       fmt::format("field={}", config.field == Switch::on ? "on" : "off")};
  if (config.field == Switch::on) {
    settings.push_back(fmt::format("field_photons={}", config.field_photons));
    settings.push_back(fmt::format("field_error={}", config.field_error));
    settings.push_back(fmt::format("field_cell_m={}", config.field_cell_m));
    return settings;
  }
  if (config.source_rays > 0) {
    settings.push_back(fmt::format("source_bounces={}", config.source_bounces));
    settings.push_back(fmt::format("diffuse_last_segment={}", config.diffuse_last_segment));
  }
  return settings;
}

}  // namespace earshot
