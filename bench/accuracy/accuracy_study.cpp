// SPDX-License-Identifier: Apache-2.0
#include "bench/accuracy/accuracy_study.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <limits>
#include <memory>

#include "bench/accuracy/study_scene.h"
#include "sim/base/process/progress.h"
#include "sim/base/stopwatch.h"

namespace earshot {
namespace {

std::vector<SceneName> study_scenes(bool quick) {
  if (quick) return {{"shoebox", "shoebox:6x3x5@0.15"}, {"two rooms", "house:2,rooms=2,area_m2=24"}};
  std::vector<SceneName> scenes{{"shoebox", "shoebox:6x3x5@0.15"}, {"house", "house:1,rooms=4,area_m2=60"}, {"large house", kLargeHouse}};
  const auto add_file = [&](const std::string& name, const std::string& file) {
    if (const auto found = scene_file(name, file)) scenes.push_back({found->name, found->spec});
  };
  add_file("small_house", "small_house.yaml");
  add_file("bathroom", "bathroom.yaml");
  add_file(kOpenScene, "ground_and_wall.yaml");
  scenes.push_back({"corridor", "shoebox:30x2.7x2@gypsum_board,gypsum_board,wood_parquet,plaster_ceiling,gypsum_board,gypsum_board"});
  return scenes;
}

/// Parts of the time of the whole study.
constexpr double kTruthFraction = 0.42;
/// More than this a truth need not be known: an error of 4 % of T20 at 24 poses of seven bands is then known to 0.1 %.
constexpr double kEnoughT20Error = 0.005;

/// Rounds where the truth is noisiest, after one in every scene, until the time is spent or all are known well enough.
void make_truths(std::vector<std::unique_ptr<StudyScene>>& scenes, double seconds,
                 const std::function<void(double fraction, const std::string& stage)>& tell) {
  const Stopwatch watch;
  std::vector<double> errors(scenes.size(), std::numeric_limits<double>::infinity());
  for (;;) {
    const auto noisiest = std::ranges::max_element(errors);
    const auto s = static_cast<std::size_t>(noisiest - errors.begin());
    TruthHalves& truth = scenes[s]->truth();
    const double round_s = truth.rounds() > 0 ? truth.seconds() / truth.rounds() : 0;
    if (!(*noisiest > kEnoughT20Error)) return;
    if (truth.rounds() > 0 && watch.wall_s() + round_s > seconds) {
      errors[s] = 0;  // no time for another round here; there may be for a quicker scene
      continue;
    }
    truth.add_round();
    const double error = truth.t20_error();
    errors[s] = std::isfinite(error) ? error : 0;
    tell(watch.wall_s() / seconds, fmt::format("{}: truth, round {}", scenes[s]->scene().name, truth.rounds()));
  }
}

/// The result of the preset `fast` in this scene as one value of a sweep.
ModeResult as_value(ModeResult fast, const AccuracyMode& mode) {
  fast.sweep = mode.sweep;
  fast.value = mode.value;
  fast.method = mode.method;
  fast.errors.by_band = {};
  fast.errors.sizes = {};
  fast.steps_per_s_one = fast.steps_per_s_two = 0;
  return fast;
}

}  // namespace

AccuracyStudy run_accuracy_study(const AccuracyOptions& options) {
  const std::vector<AccuracyMode> modes = accuracy_modes(options.quick);
  const auto num_run = static_cast<double>(std::ranges::count_if(modes, [](const auto& m) { return !m.is_fast || m.sweep == "preset"; }));
  const double all_s = 60 * options.minutes;
  const int num_poses = options.quick ? 4 : 24;

  AccuracyStudy study;
  constexpr std::uint64_t permille = 1000;
  Progress progress("accuracy", "permille", permille);
  const Stopwatch watch;
  const auto tell = [&](const std::string& stage) {
    progress.update(static_cast<std::uint64_t>(permille * std::min(watch.wall_s() / all_s, 1.0)), stage);
  };
  // First what needs a small process or the user's own commands, which may be refused.
  study.engines = compare_engines(options.engines, options.quick, tell);
  study.scaling = run_scaling_study(options.quick, tell);

  std::vector<std::unique_ptr<StudyScene>> scenes;
  for (const SceneName& scene : study_scenes(options.quick))
    scenes.push_back(std::make_unique<StudyScene>(scene, num_poses, options.quick ? kTruthRays / 4 : kTruthRays));
  make_truths(scenes, kTruthFraction * all_s, [&](double, const std::string& stage) { tell(stage); });

  for (std::size_t s = 0; s < scenes.size(); ++s) {
    const std::string name = scenes[s]->scene().name;
    study.scenes.push_back(scenes[s]->finish_truth());
    // The remaining time is divided anew, so that a slow scene takes time from all later ones and not only from the last; never less than a
    // fifth of an
    // equal part.
    const double modes_s = (1 - kTruthFraction) * all_s / static_cast<double>(scenes.size());
    const double scene_s = std::max((all_s - watch.wall_s()) / static_cast<double>(scenes.size() - s), 0.2 * modes_s);
    const ModeBudget budget{.errors_s = 0.3 * scene_s, .timing_s = 0.2 * scene_s / num_run, .env_s = 0.01 * scene_s};
    ModeResult fast;
    for (const AccuracyMode& mode : modes) {
      if (mode.is_fast && mode.sweep != "preset") {
        study.results.push_back(as_value(fast, mode));
        continue;
      }
      study.results.push_back(scenes[s]->run(mode, budget));
      if (mode.is_fast) fast = study.results.back();
      tell(name + ": " + mode.sweep + " " + mode.value);
    }
    scenes[s].reset();
    if (options.after_scene) options.after_scene(study);
  }
  return study;
}

}  // namespace earshot
