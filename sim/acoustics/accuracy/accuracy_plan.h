// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <functional>
#include <glm/vec3.hpp>
#include <span>
#include <string>
#include <string_view>
#include <vector>

#include "sim/acoustics/accuracy/accuracy_request.h"
#include "sim/acoustics/accuracy/accuracy_trial.h"
#include "sim/acoustics/core/sound_source.h"
#include "sim/acoustics/model/acoustic_scene.h"

namespace earshot {

struct AccuracyPlan {
  std::vector<AccuracyChoice> tried;  ///< in the order of trial
  std::size_t chosen = 0;
  AccuracyErrors reference_error{};  ///< standard error of the paths that judged; of several sites the largest
  int reference_runs = 0;            ///< at all sites together
  double calibration_s = 0;
  [[nodiscard]] const AccuracyChoice& choice() const { return tried[chosen]; }
};

/// Keys of the config that the planner chooses; a setting of one of them contradicts it.
std::span<const std::string_view> keys_of_accuracy();

/// The cheapest way to responses within the target: rays from the listener or from both ends, or a source field of 1 m or 0.5 m cells; how
/// many rays or photons; order of images; reflections before and after edges.  It calibrates itself on the scene: paths from both ends are
/// traced at the places until the standard error of a value is 0.7 of the target, less with few places (or 1,024 runs of 512 rays), 0.35
/// where nothing holds against these or something far cheaper may, each candidate is tried there with four seeds (4,096 rays and more: one;
/// fields: the worse of two), and the cheapest of those within 0.85 of the target, for `poses` responses, is taken.  With several sites a
/// candidate's errors are the largest of them, its costs their mean.
///
/// Predicted errors are those at the places and one standard error more.  Costs are measured, so of two choices of about equal cost either
/// may be taken from run to run; the bits are a function of the choice.  Cost: some seconds a site; a target half as large takes up to four
/// times as long.  Throws InputError where no candidate is within the target and `most_ms`, with what the best one reaches, where the paths
/// that judge it stay less certain than the target, and where what is asked for has no value.
AccuracyPlan plan_accuracy(const AccuracyRequest& request, const std::function<void(double fraction)>& progress = {});

/// The same for one source in one scene, with listeners at such places.  acoustics: its config is AccuracyRequest::config.
AccuracyPlan plan_accuracy(const AcousticScene& acoustics, const AccuracyTarget& target, const SoundSource& source,
                           std::vector<glm::vec3> places, double poses, const std::function<void(double fraction)>& progress = {});
/// The scene with the acoustics that were chosen.
AcousticScene planned_scene(const AcousticScene& acoustics, const AccuracyPlan& plan);

/// "key=value" of what the planner chose, as for --set.
std::vector<std::string> settings_of(const AccuracyChoice& choice);

}  // namespace earshot
