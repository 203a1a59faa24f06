// SPDX-License-Identifier: Apache-2.0
#include "bench/speed/scene_scale.h"

#include <fmt/format.h>

#include <algorithm>
#include <iterator>
#include <memory>
#include <system_error>
#include <utility>

#include "bench/measure/measured.h"
#include "bench/measure/statistics.h"
#include "envs/baselines/baselines.h"
#include "envs/batch/batched_env.h"
#include "envs/episodes/episode_generator.h"
#include "envs/scenes/scene_store.h"
#include "sim/base/errors.h"
#include "sim/base/stopwatch.h"

namespace earshot {
namespace {

constexpr double kSlow = 10;  ///< times the median

std::string house(std::uint64_t seed, int number) {
  return fmt::format("house:{},rooms={},detail_m=0.12", seed * 100000 + static_cast<std::uint64_t>(number), 3 + number % 4);
}

EnvConfig config_of(const SceneScaleOptions& options) {
  EnvConfig config;
  config.observation.pointgoal = true;
  config.threads = options.threads;
  config.order = EpisodeOrder::once;
  config.seed = options.seed;
  config.scene_cache_gb = options.cache_gb;
  config.scene_store = options.store.string();
  config.scene_store_gb = 1e6;
  return config;
}

double resident_mb() {
  MemorySample sample;
  read_process_memory(sample);
  return sample.resident * 1.048576;
}

/// Loads every scene twice, and makes its episodes.
EpisodeSet prepare(const SceneScaleOptions& options, const EnvConfig& config, SceneScaleResult& result) {
  EpisodeSet set;
  SceneStore store({.folder = options.store, .max_bytes = std::uint64_t{1} << 50, .warn = [&](const std::string& message) {
                      result.refused.push_back(message);
                    }});
  AcousticConfig acoustics = config.acoustics;
  if (acoustics.field == Switch::automatic) acoustics.field = Switch::off;  // as SceneCache plans
  for (int i = 0; i < options.scenes; ++i) {
    const std::string id = house(options.seed, i);
    try {
      const Stopwatch first;
      static_cast<void>(store.load(id, acoustics, config.navmesh));
      const double first_ms = first.wall_ms();
      const Stopwatch second;
      const EnvScene scene = store.load(id, acoustics, config.navmesh);
      const double second_ms = second.wall_ms();
      auto episodes = generate_episodes(id, *scene.scene, scene.navmesh,
                                        {.task = config.task,
                                         .sounds = {"synth:telephone", "synth:speech:2"},
                                         .count = options.episodes_per_scene,
                                         .seed = options.seed});
      set.episodes.insert(set.episodes.end(), episodes.begin(), episodes.end());
      result.first_load_ms.push_back(first_ms);
      result.second_load_ms.push_back(second_ms);
    } catch (const InputError& error) {
      result.refused.push_back(fmt::format("{}: {}", id, error.what()));
    }
    if (options.progress && (i + 1) % 50 == 0) options.progress(fmt::format("{} scenes preprocessed", i + 1));
  }
  std::error_code ignored;
  for (const auto& entry : std::filesystem::directory_iterator(options.store, ignored))
    result.store_mb += 1e-6 * static_cast<double>(entry.file_size(ignored));
  set.hash = episode_set_hash(set.episodes);
  return set;
}

}  // namespace

void validate(const SceneScaleOptions& o) {
  require(o.scenes > 0 && o.scenes <= 100000, "--scenes", o.scenes, "must be in [1, 100000]");
  require(o.episodes_per_scene > 0 && o.episodes_per_scene <= 1000, "--episodes", o.episodes_per_scene, "must be in [1, 1000]");
  require(o.num_envs > 0 && o.num_envs <= 4096, "--num-envs", o.num_envs, "must be in [1, 4096]");
  require(o.threads >= 0 && o.threads <= 1024, "--threads", o.threads, "must be in [0, 1024]; 0 means all cores");
  require(o.cache_gb > 0 && o.cache_gb <= 1e6, "--cache-gb", o.cache_gb, "must be in (0, 1e6]");
  require(o.minutes > 0 && o.minutes <= 1440, "--minutes", o.minutes, "must be in (0, 1440]");
  require(!o.store.empty(), "--store", o.store.string(), "must name a folder for the preprocessed scenes");
}

SceneScaleResult run_scene_scale(const SceneScaleOptions& options) {
  validate(options);
  SceneScaleResult result;
  result.options = options;
  const EnvConfig config = config_of(options);
  EpisodeSet set = prepare(options, config, result);
  if (set.episodes.empty())
    throw InputError("bench scenes", "no scene is large enough for an episode", "take another --seed or more --scenes");
  const auto scenes = make_scene_cache(config);
  result.resident_before_mb = resident_mb();
  BatchedEnv env(config, std::make_shared<const EpisodeSet>(std::move(set)), scenes, options.num_envs);
  const Stopwatch whole;
  env.reset();
  BaselineAgent oracle(Baseline::oracle, config, options.num_envs, options.seed);
  std::vector<std::int32_t> actions(static_cast<std::size_t>(options.num_envs));
  std::vector<SlowStep> steps;
  while (whole.wall_s() < 60 * options.minutes && std::ranges::any_of(env.active(), [](std::uint8_t active) { return active != 0; })) {
    oracle.act(env, actions);
    SlowStep step{.step = steps.size()};
    const double reset_before_s = env.counters().stages.reset;
    const std::uint64_t loaded_before = scenes->scenes_loaded(), built_before = scenes->sources_built();
    const Stopwatch watch;
    env.step(actions);
    step.ms = watch.wall_ms();
    step.cpu_ms = 1e3 * watch.cpu_s();
    step.reset_ms = 1e3 * (env.counters().stages.reset - reset_before_s);
    step.scenes_loaded = scenes->scenes_loaded() - loaded_before;
    step.sources_built = scenes->sources_built() - built_before;
    step.episodes_ended = env.finished().size();
    result.episodes += step.episodes_ended;
    steps.push_back(step);
    if (steps.size() % 20 == 0) {
      result.largest_cache_mb = std::max(result.largest_cache_mb, 1e-6 * static_cast<double>(scenes->bytes()));
      result.largest_held_mb = std::max(result.largest_held_mb, 1e-6 * static_cast<double>(scenes->held_bytes()));
      result.largest_resident_mb = std::max(result.largest_resident_mb, resident_mb());
    }
    if (options.progress && steps.size() % 500 == 0)
      options.progress(fmt::format("{} steps, {} episodes, {} scenes loaded", steps.size(), result.episodes, scenes->scenes_loaded()));
  }
  result.steps = steps.size();
  result.scenes_loaded = scenes->scenes_loaded();
  result.scenes_read = scenes->scene_store_counters().read;
  result.scenes_built = scenes->scene_store_counters().built;
  for (const SlowStep& step : steps) {
    result.step_ms.push_back(step.ms);
    result.step_cpu_ms.push_back(step.cpu_ms);
  }
  const double median_cpu_ms = percentile(result.step_cpu_ms, 0.5);
  result.slow_by_cpu =
      static_cast<std::uint64_t>(std::ranges::count_if(result.step_cpu_ms, [&](double cpu_ms) { return cpu_ms > kSlow * median_cpu_ms; }));
  const double median_ms = percentile(result.step_ms, 0.5);
  std::ranges::copy_if(steps, std::back_inserter(result.slow), [&](const SlowStep& step) { return step.ms > kSlow * median_ms; });
  std::ranges::sort(result.slow, [](const SlowStep& a, const SlowStep& b) { return a.ms > b.ms; });
  return result;
}

std::string scene_scale_text(const SceneScaleResult& r) {
  std::string text = fmt::format("{} houses, {} agents, {} threads, cache of {:.0f} MB\n", r.first_load_ms.size(), r.options.num_envs,
                                 r.options.threads, 1e3 * r.options.cache_gb);
  const auto line = [&](const char* name, const std::vector<double>& ms) {
    if (ms.empty()) return;
    text += fmt::format("{:<12} median {:8.1f} ms, 99 % {:8.1f}, 99.9 % {:8.1f}, longest {:8.1f}\n", name, percentile(ms, 0.5),
                        percentile(ms, 0.99), percentile(ms, 0.999), percentile(ms, 1));
  };
  line("first load", r.first_load_ms);
  line("second load", r.second_load_ms);
  line("step", r.step_ms);
  if (r.options.threads == 1) line("its core", r.step_cpu_ms);
  text += fmt::format("store {:.0f} MB; {} steps, {} episodes; scenes loaded {} ({} read, {} built)\n", r.store_mb, r.steps, r.episodes,
                      r.scenes_loaded, r.scenes_read, r.scenes_built);
  text +=
      fmt::format("memory: cache at most {:.0f} MB, held by episodes at most {:.0f} MB, resident {:.0f} MB before and at most {:.0f} MB\n",
                  r.largest_cache_mb, r.largest_held_mb, r.resident_before_mb, r.largest_resident_mb);
  text += fmt::format("steps over {:.0f} times the median: {} of {}", kSlow, r.slow.size(), r.steps);
  text += r.options.threads == 1 ? fmt::format("; by the time that they had a core: {}\n", r.slow_by_cpu) : "\n";
  for (std::size_t i = 0; i < std::min<std::size_t>(r.slow.size(), 20); ++i) {
    const SlowStep& s = r.slow[i];
    text +=
        fmt::format("  step {}: {:.1f} ms, {:.1f} with a core, {:.1f} to begin {} episodes; meanwhile {} scenes loaded, {} sources built\n",
                    s.step, s.ms, s.cpu_ms, s.reset_ms, s.episodes_ended, s.scenes_loaded, s.sources_built);
  }
  for (const std::string& refused : r.refused) text += "left out: " + refused + "\n";
  return text;
}

BenchReport scene_scale_report(const SceneScaleResult& r) {
  BenchReport report("scenes");
  const BenchJson setting{{"scenes", r.first_load_ms.size()},
                          {"envs", r.options.num_envs},
                          {"threads", r.options.threads},
                          {"cache_gb", r.options.cache_gb},
                          {"episodes_per_scene", r.options.episodes_per_scene},
                          {"seed", r.options.seed}};
  const auto single_value = [](double value) { return Measured{.value = value, .min = value, .max = value}; };
  report.add("scenes.first_load_ms", "ms", median_of(r.first_load_ms), setting);
  report.add("scenes.second_load_ms", "ms", median_of(r.second_load_ms), setting);
  if (!r.step_ms.empty()) report.add("scenes.step_ms", "ms", median_of(r.step_ms), setting);
  report.add("scenes.step_p999_ms", "ms", single_value(percentile(r.step_ms, 0.999)), setting);
  if (r.options.threads == 1 && !r.step_cpu_ms.empty()) {
    report.add("scenes.step_cpu_ms", "ms", median_of(r.step_cpu_ms), setting);
    report.add("scenes.slow_steps_by_cpu", "1", single_value(static_cast<double>(r.slow_by_cpu)), setting);
  }
  report.add("scenes.slow_steps", "1", single_value(static_cast<double>(r.slow.size())), setting);
  report.add("scenes.largest_cache_mb", "MB", single_value(r.largest_cache_mb), setting);
  report.add("scenes.largest_resident_mb", "MB", single_value(r.largest_resident_mb), setting);
  return report;
}

}  // namespace earshot
