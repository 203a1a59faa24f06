// SPDX-License-Identifier: Apache-2.0
#include "bench/soak/report.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>

#include "bench/measure/statistics.h"
#include "bench/soak/plot.h"
#include "sim/base/engine_commit.h"
#include "sim/base/files.h"
#include "sim/base/text/json.h"

namespace earshot {
namespace {

const char* name_of(BoundStatus status) {
  switch (status) {
    case BoundStatus::held:
      return "held";
    case BoundStatus::broken:
      return "BROKEN";
    default:
      return "open";
  }
}

const char* name_of(SoakFault fault) {
  switch (fault) {
    case SoakFault::not_finite:
      return "not finite";
    case SoakFault::out_of_range:
      return "out of range";
    case SoakFault::too_loud:
      return "too loud";
    default:
      return "out of the scene";
  }
}

double decibels(double ratio) { return 10 * std::log10(std::max(ratio, 1e-30)); }

double per(double count, double total) { return total > 0 ? count / total : 0.0; }

std::string bound_table(const SoakResult& result) {
  std::string text = "| bound | found | allowed | status |\n|---|---|---|---|\n";
  for (const SoakBound& bound : result.bounds())
    text += fmt::format("| {} | {} | {} | {} |\n", bound.name, bound.found, bound.bound, name_of(bound.status));
  return text;
}

std::string time_table(const SoakResult& result) {
  std::string text = "| stage | mean |";
  for (const SoakQuantile& quantile : kSoakQuantiles) text += fmt::format(" {} |", quantile.name);
  text += "\n|---|---|---|---|---|---|---|\n";
  for (std::size_t stage = 0; stage < kSoakStages.size(); ++stage) {
    text += fmt::format("| {} | {:.3g} |", stage == 0 ? "step (wall)" : kSoakStages[stage], result.stage_ms[stage].mean());
    for (const SoakQuantile& quantile : kSoakQuantiles) text += fmt::format(" {:.3g} |", quantile_of(result.stage_ms[stage], quantile));
    text += "\n";
  }
  return text;
}

std::string kind_table(const SoakResult& result) {
  std::string text = "| scene | steps | episodes | loudest, dB re expected |\n|---|---|---|---|\n";
  for (std::size_t kind = 0; kind < kNumSoakKinds; ++kind) {
    const SoakWatch::KindTotals& totals = result.kinds[kind];
    if (totals.steps == 0) continue;
    text += fmt::format("| {} | {} | {} | {:+.1f} |\n", kSoakKindNames[kind], totals.steps, totals.episodes, decibels(totals.loudest));
  }
  return text;
}

std::string list_of(const std::string& title, const std::vector<std::string>& lines) {
  if (lines.empty()) return "";
  std::string text = "\n## " + title + "\n\n";
  for (const std::string& line : lines) text += "- " + line + "\n";
  return text;
}

BenchJson slope_json(const Slope& slope) {
  return {
      {"mib_per_100k_steps", kSlopeSteps * slope.per_x}, {"standard_error", kSlopeSteps * slope.standard_error}, {"samples", slope.points}};
}

}  // namespace

double quantile_of(const LogHistogram& values, const SoakQuantile& quantile) {
  return quantile.fraction < 1 ? values.quantile(quantile.fraction) : values.max();
}

std::string soak_markdown(const SoakResult& result) {
  const SoakOptions& options = result.options;
  const BenchJson machine = machine_json();
  const auto steps = static_cast<double>(result.steps);
  std::string text = fmt::format("# Soak{}\n\n", result.finished ? "" : " (still running)");
  text += fmt::format(
      "`earshot bench soak --steps {} --scenes {} --num-envs {} --seed {}` at {}, on {} ({} cores, load {}): {} agent steps in {:.1f} min, "
      "{:.0f} per second, {:.0f} per second of processor; {} episodes, {} of them successful; {} walks through the scenes, {} scenes "
      "loaded, "
      "{} sources built.\n\n",
      options.steps, options.scenes, options.num_envs, options.seed, engine_commit(), machine["cpu"].get<std::string>(),
      json_text(machine["cores"]), json_text(machine["load_1min"]), result.steps, result.seconds / 60, per(steps, result.seconds),
      per(steps, result.cpu_seconds), result.episodes, result.successes, result.rounds,
      result.memory.empty() ? 0 : result.memory.back().scenes_loaded, result.memory.empty() ? 0 : result.memory.back().sources_built);
  text += fmt::format(
      "24 rays at each pose, responses of 0.3 s, pictures of {0} x {0}, half of the episodes at random, half greedy; every "
      "{1}th scene is hard in one of the ways listed below.\n\n## Bounds\n\n{2}\n![Soak](soak.svg)\n\n",
      options.camera_px, options.hard_every, bound_table(result));
  text += fmt::format(
      "Heard energy: mean square of each step's sound at each ear, against (1/(4 pi r)^2 at the shortest distance r of the step + diffuse "
      "field of the source's closed room, 1/(pi A) but at most c T/(4 pi V)) times the largest mean square of the dry sound in any step. "
      "Allowed above it: 6 dB for the head and 12 dB for four images in phase or for the loudest place of a standing wave in 10^7. "
      "Median {:+.1f} dB, 99.9 % below {:+.1f} dB.\n\n",
      decibels(result.loudness.quantile(0.5)), decibels(result.loudness.quantile(0.999)));
  const double in_use = kSlopeSteps * result.heap_slope.per_x, in_use_error = kSlopeSteps * result.heap_slope.standard_error;
  const MemorySample last = result.memory.empty() ? MemorySample{} : result.memory.back();
  text += fmt::format(
      "Memory at the end: {:.0f} MiB resident, {:.0f} MiB of heap in use ({:+.3f} ± {:.3f} MiB per 100,000 steps), {:.0f} MiB of heap "
      "free, "
      "scene cache {:.0f} MiB. Slopes are of the samples after the first {} steps: {}.\n\n",
      last.resident, last.heap_in_use, in_use, in_use_error, last.heap_free, last.cache, result.warm_up_steps,
      result.all_scenes_before ? "by then every scene had been loaded" : "not every scene had been loaded by then");
  text += fmt::format("## Milliseconds of a step of {} agents\n\nWall time of the call; stages summed over agents and {} threads.\n\n{}",
                      options.num_envs, result.threads, time_table(result));
  text += fmt::format("\n## Kinds of scenes\n\n{}", kind_table(result));
  std::vector<std::string> examples;
  for (const SoakWatch::Example& example : result.examples) examples.push_back(fmt::format("{}: {}", name_of(example.fault), example.what));
  text += list_of("First faults", examples);
  std::vector<std::string> quarantined;
  for (std::size_t i = 0; i < kNumFaults; ++i)
    if (const auto fault = static_cast<Fault>(i); result.quarantined.of(fault) > 0)
      quarantined.push_back(fmt::format("{}: {}", name_of(fault), result.quarantined.of(fault)));
  text += list_of("Quarantined episodes, by reason", quarantined);
  text += list_of("Replays that differ", result.differing);
  text += list_of("Scenes too small for an episode", result.refused_scenes);
  return text;
}

BenchJson soak_json(const SoakResult& result) {
  BenchJson bounds = BenchJson::array(), memory = BenchJson::array(), stages = BenchJson::object(), kinds = BenchJson::object();
  for (const SoakBound& bound : result.bounds())
    bounds.push_back({{"name", bound.name}, {"found", bound.found}, {"allowed", bound.bound}, {"status", name_of(bound.status)}});
  for (const MemorySample& s : result.memory)
    memory.push_back({s.steps, std::round(10 * s.seconds) / 10, std::round(100 * s.resident) / 100, std::round(100 * s.heap_in_use) / 100,
                      std::round(100 * s.heap_free) / 100, std::round(100 * s.cache) / 100, s.scenes_held, s.scenes_loaded, s.sources_built,
                      s.episodes});
  for (std::size_t stage = 0; stage < kSoakStages.size(); ++stage) {
    BenchJson times = BenchJson::object();
    times["mean"] = result.stage_ms[stage].mean();
    for (const SoakQuantile& quantile : kSoakQuantiles) times[quantile.name] = quantile_of(result.stage_ms[stage], quantile);
    stages[kSoakStages[stage]] = std::move(times);
  }
  for (std::size_t kind = 0; kind < kNumSoakKinds; ++kind)
    kinds[kSoakKindNames[kind]] = {{"steps", result.kinds[kind].steps},
                                   {"episodes", result.kinds[kind].episodes},
                                   {"loudest_db", decibels(result.kinds[kind].loudest)}};
  return {{"passed", result.passed()},
          {"finished", result.finished},
          {"steps", result.steps},
          {"seconds", result.seconds},
          {"cpu_seconds", result.cpu_seconds},
          {"episodes", result.episodes},
          {"successes", result.successes},
          {"rounds", result.rounds},
          {"scenes", result.options.scenes},
          {"envs", result.options.num_envs},
          {"threads", result.threads},
          {"seed", result.options.seed},
          {"commit", engine_commit()},
          {"machine", machine_json()},
          {"bounds", std::move(bounds)},
          {"resident_slope", slope_json(result.resident_slope)},
          {"heap_slope", slope_json(result.heap_slope)},
          {"warm_up_steps", result.warm_up_steps},
          {"stage_ms", std::move(stages)},
          {"kinds", std::move(kinds)},
          {"largest_reward", result.largest_reward},
          {"cached_responses", result.cached_responses},
          {"memory_columns",
           {"steps", "seconds", "resident_mib", "heap_in_use_mib", "heap_free_mib", "cache_mib", "scenes_held", "scenes_loaded",
            "sources_built", "episodes"}},
          {"memory", std::move(memory)}};
}

void write_soak_files(const SoakResult& result, const std::filesystem::path& folder) {
  write_file_atomically(folder / "soak.md", soak_markdown(result));
  write_file_atomically(folder / "soak.json", json_text(soak_json(result)) + "\n");
  write_file_atomically(folder / "soak.svg", soak_svg(result));
}

BenchReport soak_bench_report(const SoakResult& result) {
  BenchReport report("soak");
  const BenchJson setting{{"scenes", result.options.scenes}, {"envs", result.options.num_envs}, {"threads", result.threads},
                          {"steps", result.steps},           {"seed", result.options.seed},     {"camera_px", result.options.camera_px}};
  const auto add = [&](const std::string& name, const std::string& unit, double value) {
    report.add(name, unit, {value, value, value}, setting);
  };
  add("soak.steps", "1", static_cast<double>(result.steps));
  add("soak.steps_per_s", "1/s", per(static_cast<double>(result.steps), result.seconds));
  add("soak.steps_per_cpu_s", "1/s", per(static_cast<double>(result.steps), result.cpu_seconds));
  add("soak.episodes", "1", static_cast<double>(result.episodes));
  add("soak.not_finite", "1",
      static_cast<double>(result.faults[static_cast<std::size_t>(SoakFault::not_finite)] + result.nonfinite_events));
  const double slope = kSlopeSteps * result.resident_slope.per_x, error = kSlopeSteps * result.resident_slope.standard_error;
  report.add("soak.resident_mib_per_100k_steps", "MiB", {slope, slope - 2 * error, slope + 2 * error}, setting);
  add("soak.loudest_db", "dB", decibels(result.loudness.max()));
  add("soak.replays_that_differ", "1", result.replays_that_differ);
  for (const SoakQuantile& quantile : kSoakQuantiles)
    add(fmt::format("soak.step_ms.{}", quantile.name), "ms", quantile_of(result.stage_ms[0], quantile));
  return report;
}

}  // namespace earshot
