// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <functional>
#include <optional>
#include <string>
#include <vector>

#include "bench/measure/bench_report.h"
#include "sim/acoustics/accuracy/accuracy_plan.h"

namespace earshot {

struct PromiseOptions {
  bool quick = false;                ///< two scenes, one target, a rough truth: that everything works
  std::vector<std::string> scenes;   ///< SCENEs in place of the usual ten
  std::vector<std::string> targets;  ///< in place of 2, 5 (with 1 dB of DRR and EDC) and 10 % of T20
};

/// A target in a scene: promised, predicted and measured errors.
struct KeptPromise {
  std::string scene;
  AccuracyTarget target;
  std::optional<AccuracyPlan> plan;  ///< nullopt: none could be promised
  AccuracyErrors measured{};         ///< at places where the planner has not been, with other seeds
  double total_ms = 0;               ///< 300 responses of one source, planning apart
  std::string preset;                ///< the cheapest that measures within the target; empty: none does
  double preset_ms = 0;
  [[nodiscard]] bool kept() const { return plan && target.used(measured) <= 1; }
};

struct PromiseScene {
  std::string name, spec;
  AccuracyErrors truth_error{};  ///< standard error
  std::vector<KeptPromise> promises;
};

/// Question: does the planner keep what it promises, and what does it save over the fixed presets?  One source, 36 poses of a
/// walk: it calibrates at every third and is measured at twelve others, against paths of their own seeds.  after_scene: called
/// with each.
std::vector<PromiseScene> run_promises(const PromiseOptions& options, const std::function<void(const PromiseScene&)>& after_scene = {});

/// A table for people, one line per scene and target.
std::string promises_markdown(const std::vector<PromiseScene>& scenes);
BenchReport promises_report(const std::vector<PromiseScene>& scenes);

}  // namespace earshot
