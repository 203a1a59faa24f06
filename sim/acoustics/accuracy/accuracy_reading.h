// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <optional>
#include <span>
#include <vector>

#include "sim/acoustics/accuracy/accuracy_target.h"
#include "sim/acoustics/model/acoustic_scene.h"
#include "sim/acoustics/response/energy_response.h"

namespace earshot {

/// Metrics of one response by which its accuracy is judged, per band.
struct AccuracyReading {
  std::vector<std::optional<double>> t20_s, drr_db;
  std::vector<std::vector<float>> edc_db;  ///< re its own start, steps of 4 ms of 4 s; -60 where it has ended; empty without energy
};
AccuracyReading read_accuracy(const AcousticScene& scene, const EnergyResponse& response);

/// Root mean square errors over bands and places of `test`, which holds the places of the truth once or several times in turn (seeds), from
/// two independent estimates of the truth: the mean of (test - first)(test - second) is the mean square of test less truth, whatever the
/// noise of the two, as long as neither has a bias (cross-validated distances: Walther et al. 2016, NeuroImage 137, 188-200; for relative
/// differences but for the square of that noise).  Of decay curves the mean is taken over time too (0 to -30 dB).  What the test lacks
/// where the truth has it counts as 100 % and 10 dB, a curve as one that has ended.  A negative mean square, noise, is 0; sigmas: of its
/// standard errors, from the spread over places, added.
AccuracyErrors errors_between(std::span<const AccuracyReading> test, std::span<const AccuracyReading> first,
                              std::span<const AccuracyReading> second, double sigmas = 0);
/// The same measures of what two independent estimates differ by, over two: the standard error of their mean.
AccuracyErrors half_difference(std::span<const AccuracyReading> first, std::span<const AccuracyReading> second);

}  // namespace earshot
