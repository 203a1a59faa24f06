// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <functional>
#include <glm/vec3.hpp>
#include <memory>
#include <span>
#include <vector>

#include "sim/acoustics/accuracy/accuracy_reading.h"
#include "sim/acoustics/core/sound_source.h"

namespace earshot {

/// The truth at some places, as two independent halves: bidirectional paths, unbiased, with image paths of order four and all edges.  Not
/// thread-safe.
class AccuracyReference {
 public:
  /// config: of the responses that are judged; its switches, bands, length and bins hold here too.  Throws InputError as AcousticScene.
  AccuracyReference(const std::shared_ptr<const Scene>& scene, const AcousticConfig& config, const SoundSource& source,
                    std::vector<glm::vec3> places);

  /// Adds runs, twice as many each time, until target.used(standard_error()) <= `most` or there are `max_runs`.  The content of a run does
  /// not depend on threads or time.  progress: runs done over max_runs.
  void refine(const AccuracyTarget& target, double most, int max_runs, const std::function<void(double fraction)>& progress = {});
  [[nodiscard]] int runs() const { return runs_; }
  [[nodiscard]] std::span<const glm::vec3> places() const { return places_; }
  /// Of the mean of both halves.
  [[nodiscard]] const AccuracyErrors& standard_error() const { return standard_error_; }
  /// Of responses at the places (errors_between).
  [[nodiscard]] AccuracyErrors errors_of(std::span<const AccuracyReading> test, double sigmas) const {
    return errors_between(test, readings_[0], readings_[1], sigmas);
  }

 private:
  void run();
  AcousticScene scene_;
  EarlyCandidates candidates_;
  std::vector<glm::vec3> places_;
  std::array<std::vector<EnergyResponse>, 2> halves_;  ///< sums of late energy
  std::array<std::vector<AccuracyReading>, 2> readings_;
  AccuracyErrors standard_error_{};
  int runs_ = 0;
};

}  // namespace earshot
