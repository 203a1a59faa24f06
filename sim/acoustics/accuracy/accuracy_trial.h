// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <memory>
#include <span>
#include <string>

#include "sim/acoustics/accuracy/accuracy_reference.h"
#include "sim/acoustics/source_field/source_field.h"
#include "sim/base/stopwatch.h"

namespace earshot {

/// One way to compute the responses of a source, tried at a few places.
struct AccuracyChoice {
  std::string method;                         ///< "listener rays", "source field" or "both ends"
  AcousticConfig config;                      ///< complete: the same bits without a planner
  AccuracyErrors measured{};                  ///< against the reference
  AccuracyErrors predicted{};                 ///< the same plus one standard error of its square: the error promised for other places
  double per_source_ms = 0, per_pose_ms = 0;  ///< as measured, one source and one response without synthesis
  [[nodiscard]] double total_ms(double poses) const { return per_source_ms + poses * per_pose_ms; }
};

/// Milliseconds of a candidate: on one thread those of its processor, as other work on the machine would count as its own; else of the
/// wall.
double spent_ms(const Stopwatch& watch, const AcousticConfig& config);

/// The config as it is, with `seeds` seeds of its rays, or with one field if its plan has one.
AccuracyChoice try_config(const std::shared_ptr<const Scene>& scene, std::string method, const AcousticConfig& config,
                          const SoundSource& source, const AccuracyReference& reference, int seeds);

/// The same candidate at several sites: the largest error of each kind, the mean cost.
AccuracyChoice worst_of(std::span<const AccuracyChoice> at_sites);

/// Errors and time per response of `choice` at the places of the reference.  scenes: the same under several seeds.  field: null, or of the
/// source.
void try_responses(std::span<const AcousticScene> scenes, const EarlyCandidates& candidates, const SourceField* field,
                   const AccuracyReference& reference, AccuracyChoice& choice);

}  // namespace earshot
