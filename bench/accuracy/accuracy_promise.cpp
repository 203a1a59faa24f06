// SPDX-License-Identifier: Apache-2.0
#include "bench/accuracy/accuracy_promise.h"

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <cmath>

#include "bench/measure/bench_scene.h"
#include "sim/base/errors.h"
#include "sim/base/process/progress.h"

namespace earshot {
namespace {

constexpr double kPoses = 300;

std::vector<SceneName> usual_scenes(bool quick) {
  if (quick) return {{"shoebox", "shoebox:6x3x5@0.15"}, {"two rooms", "house:2,rooms=2,area_m2=24"}};
  std::vector<SceneName> scenes = {
      {"shoebox", "shoebox:6x3x5@0.15"},
      {"live closet", "shoebox:2.5x2.4x2@0.04"},
      {"dead hall", "shoebox:20x6x15@0.35"},
      {"corridor", "shoebox:30x2.7x2@gypsum_board,gypsum_board,wood_parquet,plaster_ceiling,gypsum_board,gypsum_board"},
      {"two rooms", "house:2,rooms=2,area_m2=24"},
      {"four rooms", "house:1,rooms=4,area_m2=60"},
      {"three rooms", "house:5,rooms=3,area_m2=45"},
      {"eight rooms", kLargeHouse},
      {"floor", "floor:1"}};
  if (const auto open = scene_file("open", "ground_and_wall.yaml")) scenes.push_back(*open);
  return scenes;
}

std::vector<AccuracyTarget> targets_of(const PromiseOptions& options) {
  std::vector<std::string> texts = options.targets;
  if (texts.empty())
    texts = options.quick ? std::vector<std::string>{"t20=10%"} : std::vector<std::string>{"t20=2%", "t20=5%,drr=1dB,edc=1dB", "t20=10%"};
  std::vector<AccuracyTarget> targets;
  for (const std::string& text : texts) targets.push_back(AccuracyTarget::parse(text));
  return targets;
}

AcousticConfig base_config() {
  AcousticConfig config = acoustic_preset("fast");
  config.rir_length_s = 0;
  return config;
}

/// Every third of 36 poses of the walk, from `first` on.
std::vector<glm::vec3> places_of(const BenchScene& scene, std::size_t first) {
  std::vector<glm::vec3> places;
  const std::vector<WalkPose> poses = scene.some_poses(36);
  for (std::size_t i = first; i < poses.size(); i += 3) places.push_back(poses[i].ears());
  return places;
}

class SceneTrial {
 public:
  SceneTrial(const SceneName& name, bool quick)
      : scene_(load_bench_scene(name.name, name.spec)),
        seeded_(with_seed(base_config())),
        truth_(scene_.scene, seeded_, scene_.source(), places_of(scene_, 1)) {
    Progress progress(fmt::format("truth of {}", name.name), "%", 100);
    truth_.refine(AccuracyTarget::parse("t20=2%"), quick ? 2 : 1, quick ? 16 : 256,
                  [&](double fraction) { progress.update(static_cast<std::uint64_t>(100 * fraction)); });
    if (quick) preset_names_.pop_back();
  }

  [[nodiscard]] const AccuracyErrors& truth_error() const { return truth_.standard_error(); }

  KeptPromise keep(const AccuracyTarget& target) {
    KeptPromise promise;
    promise.scene = scene_.name;
    promise.target = target;
    for (std::size_t i = 0; i < preset_names_.size() && promise.preset.empty(); ++i)
      if (target.used(preset(i).measured) <= 1) promise.preset = preset_names_[i], promise.preset_ms = preset(i).total_ms(kPoses);
    Progress progress("calibration", "%", 100);
    try {
      promise.plan = plan_accuracy({.config = base_config(),
                                    .target = target,
                                    .sites = {{.scene = scene_.scene, .source = scene_.source(), .places = places_of(scene_, 0)}},
                                    .poses = kPoses},
                                   [&](double fraction) { progress.update(static_cast<std::uint64_t>(100 * fraction)); });
    } catch (const InputError& refused) {
      fmt::print(stderr, "{}: {}\n", scene_.name, refused.what());
      return promise;
    }
    const AccuracyChoice& choice = promise.plan->choice();
    const AccuracyChoice measured = try_config(scene_.scene, choice.method, with_seed(choice.config), scene_.source(), truth_, 4);
    promise.measured = measured.measured;
    promise.total_ms = measured.total_ms(kPoses);
    return promise;
  }

 private:
  /// Tried when it is asked for: `high` takes minutes in a live room.
  const AccuracyChoice& preset(std::size_t index) {
    while (presets_.size() <= index) {
      const std::string& name = preset_names_[presets_.size()];
      AcousticConfig config = with_seed(acoustic_preset(name));
      config.rir_length_s = 0;
      config.threads = 1;
      presets_.push_back(try_config(scene_.scene, name, config, scene_.source(), truth_, name == "high" ? 1 : 4));
    }
    return presets_[index];
  }
  static AcousticConfig with_seed(AcousticConfig config) {
    config.seed = 20'011;
    return config;
  }
  BenchScene scene_;
  AcousticConfig seeded_;
  AccuracyReference truth_;
  std::vector<std::string> preset_names_ = {"fast", "balanced", "high"};  ///< cheapest first
  std::vector<AccuracyChoice> presets_;                                   ///< of the first of them
};

std::string cell(const AccuracyErrors& errors, AccuracyKind kind) {
  const double value = errors[static_cast<std::size_t>(kind)] * unit_of(kind).scale;
  return std::isnan(value) ? "-" : fmt::format("{:.2f}", value);
}

}  // namespace

std::vector<PromiseScene> run_promises(const PromiseOptions& options, const std::function<void(const PromiseScene&)>& after_scene) {
  const std::vector<AccuracyTarget> targets = targets_of(options);
  std::vector<SceneName> scenes = usual_scenes(options.quick);
  if (!options.scenes.empty()) {
    scenes.clear();
    for (const std::string& spec : options.scenes) scenes.push_back({spec, spec});
  }
  std::vector<PromiseScene> done;
  for (const SceneName& name : scenes) {
    SceneTrial trial(name, options.quick);
    PromiseScene& scene = done.emplace_back();
    scene.name = name.name;
    scene.spec = name.spec;
    scene.truth_error = trial.truth_error();
    for (const AccuracyTarget& target : targets) scene.promises.push_back(trial.keep(target));
    if (after_scene) after_scene(scene);
  }
  return done;
}

std::string promises_markdown(const std::vector<PromiseScene>& scenes) {
  std::string text =
      "| scene | asked | chosen | predicted T20 % / DRR dB / EDC dB | measured | kept | 300 responses ms | calibration s | cheapest preset "
      "within | "
      "times faster |\n|---|---|---|---|---|---|---|---|---|---|\n";
  for (const PromiseScene& scene : scenes)
    for (const KeptPromise& promise : scene.promises) {
      if (!promise.plan) {
        text += fmt::format("| {} | {} | refused | - | - | no | - | - | {} | - |\n", scene.name, promise.target.text(), promise.preset);
        continue;
      }
      const auto errors = [&](const AccuracyErrors& measured) {
        return fmt::format("{} / {} / {}", cell(measured, AccuracyKind::t20), cell(measured, AccuracyKind::drr),
                           cell(measured, AccuracyKind::edc));
      };
      const AccuracyChoice& choice = promise.plan->choice();
      const int count = choice.config.field == Switch::on ? choice.config.field_photons : choice.config.rays;
      text += fmt::format("| {} | {} | {} {} | {} | {} | {} | {:.0f} | {:.1f} | {} | {} |\n", scene.name, promise.target.text(),
                          choice.method, count, errors(choice.predicted), errors(promise.measured), promise.kept() ? "yes" : "no",
                          promise.total_ms, promise.plan->calibration_s, promise.preset.empty() ? "none" : promise.preset,
                          promise.preset.empty() ? "-" : fmt::format("{:.1f}", promise.preset_ms / promise.total_ms));
    }
  return text;
}

BenchReport promises_report(const std::vector<PromiseScene>& scenes) {
  BenchReport report("promise");
  const auto single = [](double value) { return Measured{value, value, value}; };
  for (const PromiseScene& scene : scenes)
    for (const KeptPromise& promise : scene.promises) {
      BenchJson setting = {{"scene", scene.name}, {"spec", scene.spec}, {"target", promise.target.text()}, {"poses", kPoses}};
      const std::string name = fmt::format("promise.{}", promise.target.text());
      report.add(name + ".kept", "", single(promise.kept() ? 1 : 0), setting);
      if (!promise.plan) continue;
      const AccuracyChoice& choice = promise.plan->choice();
      setting["method"] = choice.method;
      setting["settings"] = settings_of(choice);
      for (std::size_t kind = 0; kind < kNumAccuracyKinds; ++kind) {
        const AccuracyUnit& unit = unit_of(static_cast<AccuracyKind>(kind));
        report.add(fmt::format("{}.predicted_{}", name, unit.name), unit.suffix, single(choice.predicted[kind] * unit.scale), setting);
        report.add(fmt::format("{}.measured_{}", name, unit.name), unit.suffix, single(promise.measured[kind] * unit.scale), setting);
        report.add(fmt::format("{}.truth_error_{}", name, unit.name), unit.suffix, single(scene.truth_error[kind] * unit.scale), setting);
      }
      report.add(name + ".total_ms", "ms", single(promise.total_ms), setting);
      report.add(name + ".calibration_s", "s", single(promise.plan->calibration_s), setting);
      if (promise.preset.empty()) continue;
      setting["preset"] = promise.preset;
      report.add(name + ".preset_ms", "ms", single(promise.preset_ms), setting);
    }
  return report;
}

}  // namespace earshot
