// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <map>
#include <memory>
#include <tuple>
#include <vector>

#include "bench/accuracy/accuracy_study.h"
#include "bench/measure/truth_halves.h"

namespace earshot {

/// Seconds that parts of the run of one mode may take.
struct ModeBudget {
  double errors_s = 0, timing_s = 0, env_s = 0;
};

/// One scene of the study: its truth, and modes that are held against it.
class StudyScene {
 public:
  StudyScene(const SceneName& scene, int num_poses, int truth_rays);

  [[nodiscard]] TruthHalves& truth() { return truth_; }
  [[nodiscard]] const BenchScene& scene() const { return scene_; }
  /// Reads the truth as it stands; to be called before run().
  SceneFacts finish_truth();
  /// Errors of two draws, of two seeds and where there is a field two fields; times of the first.
  ModeResult run(const AccuracyMode& mode, const ModeBudget& budget);

 private:
  struct Draw;
  struct Rendering;
  ModeErrors measure_errors(const AccuracyMode& mode, const std::array<Draw, 2>& draws, const Rendering& rendering, double budget_s) const;
  [[nodiscard]] std::uint64_t noise_key() const;  ///< one for all modes
  std::shared_ptr<const SynthesisTables> tables_of(const AcousticScene& scene);
  void measure_times(const Draw& draw, const Rendering& rendering, double budget_s, ModeResult& result) const;
  void measure_steps(const AcousticScene& acoustics, double budget_s, ModeResult& result) const;

  BenchScene scene_;
  TruthHalves truth_;
  std::vector<HeardResponse> heard_;  ///< mean of both halves
  std::vector<TruthValues> values_;
  std::map<std::tuple<int, int, float>, std::shared_ptr<const SynthesisTables>> tables_;
};

}  // namespace earshot
