// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <array>
#include <functional>
#include <string>
#include <vector>

#include "bench/accuracy/accuracy_modes.h"
#include "bench/accuracy/engine_comparison.h"
#include "bench/accuracy/scaling_study.h"
#include "bench/measure/response_errors.h"

namespace earshot {

/// Errors of a mode in a scene.
struct ModeErrors {
  int poses = 0;
  std::array<ErrorSummary, kNumErrorKinds> all = {};
  std::array<std::vector<ErrorSummary>, kNumErrorKinds> by_band = {};  ///< of presets
  std::array<std::vector<double>, kNumErrorKinds> sizes = {};          ///< of presets: absolute values in the unit of files
};

/// One mode in one scene.
struct ModeResult {
  std::string scene, sweep, value, method;
  double rir_length_s = 0;
  bool field = false;
  double per_source_ms = 0;                         ///< candidates and photon pass
  double per_rir_ms = 0, rirs_per_s_two = 0;        ///< warm, on one thread; of two threads that each render their own poses
  double steps_per_s_one = 0, steps_per_s_two = 0;  ///< of an environment of eight agents; 0: not measured
  ModeErrors errors = {};
  [[nodiscard]] const ErrorSummary& error(ErrorKind kind) const { return errors.all[static_cast<std::size_t>(kind)]; }
  /// Milliseconds per RIR on one thread with n of them per source.
  [[nodiscard]] double shared_ms(int n) const { return per_rir_ms + per_source_ms / n; }
};

/// The scene in the open.  It has no reverberation: means over scenes of decay times leave it out, those of levels do not.
inline constexpr const char* kOpenScene = "open";

/// A scene's truth in a few words.
struct SceneFacts {
  std::string name, spec;
  std::size_t triangles = 0;
  double rt60_s = 0;                     ///< T20 of the truth, mean over bands and poses
  double truth_error_pct = 0;            ///< standard error of one T20 of the truth, root mean square over bands and poses
  int truth_rounds = 0, truth_rays = 0;  ///< runs of either half at a pose, and listener rays of one
  double truth_s = 0;                    ///< seconds that they took
  int poses = 0;
  std::vector<float> bands_hz = {};
};

struct AccuracyStudy {
  std::vector<SceneFacts> scenes;
  std::vector<ModeResult> results;  ///< by scene, modes in the order of accuracy_modes()
  ScalingStudy scaling;
  EngineComparison engines;
};

struct AccuracyOptions {
  bool quick = false;
  double minutes = 20;                                         ///< of the whole study on two cores; poses and repeats are cut to fit
  std::vector<EngineCommand> engines = {};                     ///< other engines for the comparison in shoeboxes
  std::function<void(const AccuracyStudy&)> after_scene = {};  ///< with what there is so far: a study that is cut short leaves its files
};

/// Question: how much time does accuracy cost?  Every mode in every scene against a truth in two halves.  Throws InputError if an engine
/// breaks the protocol.
AccuracyStudy run_accuracy_study(const AccuracyOptions& options);

}  // namespace earshot
