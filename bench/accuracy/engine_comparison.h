// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <functional>
#include <memory>
#include <string>
#include <vector>

#include "bench/accuracy/engine_process.h"
#include "bench/measure/response_errors.h"
#include "sim/scene/scene.h"

namespace earshot {

/// One engine at one setting (ours) or one time allowed (others), over all rooms and listeners.
struct EnginePoint {
  std::string engine, setting;
  double allowed_ms = 0;               ///< per response; 0: nothing was asked
  double ms = 0;                       ///< per response as measured, mean over the rooms
  std::vector<ErrorSummary> t20 = {};  ///< per octave, fractions
  ErrorSummary t20_all = {}, c50_db = {}, drr_db = {};
  /// The same against the exact pressure of the interfering images: the reference for an engine that adds pressures.
  ErrorSummary pressure_t20 = {}, pressure_c50_db = {}, pressure_drr_db = {};
};

struct EngineComparison {
  std::vector<ShoeboxRoom> rooms;
  std::vector<EnginePoint> points;
  std::vector<std::vector<RoomMetrics>> energies, pressures;  ///< the two truths, by room and listener
  std::vector<std::string> left_out;                          ///< one line per engine that is not available
};

/// Three boxes of mirrors whose walls absorb by octave, none of them alike.  quick: the smallest.
std::vector<ShoeboxRoom> comparison_rooms(bool quick);
/// The scene that ours render of it, without scattering.
std::shared_ptr<const Scene> mirror_box(const ShoeboxRoom& room);
/// The engines that are asked where the user names none: pyroomacoustics by the script that ships with the source, in two ways.
std::vector<EngineCommand> usual_engines();

/// Question: at equal time, whose responses are nearer to the exact sum of images?  Ours at several numbers of rays and photons; each other
/// engine at several times per response.  All render one channel of the same rate and length; T20, C50 and DRR are measured on those
/// samples by one estimator.  Warm, one thread.  Throws InputError as ask_engine.
EngineComparison compare_engines(const std::vector<EngineCommand>& engines, bool quick,
                                 const std::function<void(const std::string& stage)>& progress = {});

/// A table; empty without points.
std::string engines_markdown(const EngineComparison& comparison);
/// Time per response against the error of T20 and of C50, one line per engine.
std::string engines_figure(const EngineComparison& comparison);

/// Errors of rendered responses, by room and listener, against the exact ones; the fields of pressures stay empty.
EnginePoint judge_responses(const std::vector<std::vector<RoomMetrics>>& exact, const std::vector<std::vector<RoomMetrics>>& rendered);

}  // namespace earshot
