// SPDX-License-Identifier: Apache-2.0
#include "bench/speed/bench_env.h"

#include <fmt/format.h>
#include <tbb/info.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdio>

#include "bench/measure/statistics.h"
#include "bench/speed/bare_ray_rates.h"
#include "envs/baselines/baselines.h"
#include "envs/batch/batched_env.h"
#include "envs/episodes/agent_scenario.h"
#include "envs/episodes/episode_generator.h"
#include "sim/base/errors.h"
#include "sim/base/random.h"
#include "sim/base/stopwatch.h"

namespace earshot {
namespace {

constexpr int kEpisodes = 32, kSharedGoals = 10;
/// For scenes where the default filter finds no episode, and for starts of further agents.
constexpr EpisodeFilter kNearStarts{.min_geodesic_m = 1.f, .max_geodesic_m = 100.f, .min_ratio = 0.f, .max_tries = 1000};

struct Senses {
  const char* name;
  bool sound, picture;
};
constexpr Senses kAll{"all", true, true}, kPictureOnly{"no sound", false, true}, kSoundOnly{"no picture", true, false},
    kNone{"none", false, false};

struct Stage {
  const char* name;
  double StageSeconds::*seconds;
};
constexpr std::array<Stage, 7> kStages{{{"move", &StageSeconds::move},
                                        {"trace", &StageSeconds::trace},
                                        {"synthesize", &StageSeconds::synthesize},
                                        {"convolve", &StageSeconds::convolve},
                                        {"render", &StageSeconds::render},
                                        {"observe", &StageSeconds::observe},
                                        {"reset", &StageSeconds::reset}}};
constexpr std::array<std::pair<const char*, double>, 4> kPercentiles{{{"p50", 0.5}, {"p95", 0.95}, {"p99", 0.99}, {"max", 1.0}}};

struct EnvTimes {
  std::vector<double> steps_per_s;
  std::vector<double> alone_per_s;  ///< the same without the oracle that acts, which asks for two distances a step
  std::array<std::vector<double>, kStages.size()> stage_ms;
  std::vector<std::vector<double>> batch_ms;  ///< of each repeat, every batch step
  double resident_mb = 0, cache_mb = 0;       ///< at the end
};

Renderer renderer_of(const std::string& name) {
  if (name == "embree") return Renderer::embree;
  if (name == "egl") return Renderer::egl;
  require(name == "auto", "--renderer", name, "must be embree, egl or auto");
  return Renderer::automatic;
}

/// Episodes of the default filter; in a scene without any, such as a single room, shorter and straighter ones.
std::vector<Episode> episodes_in(const std::string& id, const EnvScene& scene, const TaskConfig& task, int goals) {
  const auto draw = [&](const EpisodeFilter& filter) {
    return generate_episodes(
        id, *scene.scene, scene.navmesh,
        {.task = task, .filter = filter, .sounds = {"synth:telephone", "synth:music"}, .count = kEpisodes, .seed = 1, .num_goals = goals});
  };
  try {
    return draw({});
  } catch (const InputError&) {
    return draw(kNearStarts);
  }
}

/// Forward three times in four, else a turn: agents are all over the scene and end with their 500 steps, so that as many act all the time.
void walk(const BatchedEnv& env, std::span<std::int32_t> actions) {
  for (std::size_t row = 0; row < actions.size(); ++row) {
    const int index = static_cast<int>(row);
    const std::uint32_t draw =
        RandomStream(0, Purpose::random_agent, static_cast<std::uint32_t>(row), static_cast<std::uint32_t>(env.agent(index).episode_count),
                     static_cast<std::uint32_t>(env.agent(index).episode_step))
            .below(8, 0);
    actions[row] = draw < 6 ? 1 : draw == 6 ? 2 : 3;
  }
}

/// The scene with its episodes, for one choice of senses and any number of agents and threads.
class EnvBench {
 public:
  EnvBench(const Senses& senses, const EnvBenchOptions& options) : senses_(senses), options_(options) {
    config_.observation.spectrogram = senses.sound;
    config_.observation.depth = senses.picture;
    config_.observation.pointgoal = true;
    if (senses.picture) {
      config_.observation.renderer = renderer_of(options.renderer);
      config_.observation.egl_device = options.egl_device;
    }
    config_.observation.camera.width_px = options.width_px;
    config_.observation.camera.height_px = options.height_px;
    if (options.field && senses.sound) config_.acoustics.field = Switch::on;
    config_.agents = options.agents;
    validate(config_);
    scenes_ = make_scene_cache(config_);
    loaded_ = scenes_->scene(options.scene);
    EpisodeSet set;
    set.episodes = episodes_in(options.scene, *loaded_, config_.task, options.field ? kSharedGoals : 0);
    AgentScenario agents{.count = options.agents};
    if (options.agent_sounds && options.agents > 1) agents.sounds = {"synth:speech:1", "synth:bird", "synth:engine", "synth:alarm"};
    apply_agents(agents, *loaded_->scene, loaded_->navmesh, {.task = config_.task, .filter = kNearStarts, .seed = 1}, set.episodes);
    set_ = std::make_shared<const EpisodeSet>(std::move(set));
    if (!options.field) return;
    const Stopwatch watch;
    for (const Episode& episode : set_->episodes) scenes_->source(episode.scene_id, episode.goal_position, config_.task.source_height_m);
    sources_s_ = watch.wall_s();
  }

  /// The first repeat warms up: without fields, sources are built on the way.
  EnvTimes run(int envs, int threads, int repeats, double seconds) const {
    EnvConfig config = config_;
    config.threads = threads;
    BatchedEnv env(config, set_, scenes_, envs);
    env.reset();
    EnvTimes times;
    BaselineAgent oracle(Baseline::oracle, env.config(), env.num_rows(), 0);
    std::vector<std::int32_t> actions(static_cast<std::size_t>(env.num_rows()));
    for (int repeat = 0; repeat <= repeats; ++repeat) {
      const StageSeconds before = env.counters().stages;
      const Stopwatch watch;
      std::vector<double> batch_ms;
      double steps = 0, step_s = 0;
      do {
        // The oracle's mix of turns and moves, ends of episodes included, is close to that of a trained policy.
        if (options_.walk)
          walk(env, actions);
        else
          oracle.act(env, actions);
        const Stopwatch batch;
        env.step(actions);
        const double batch_s = batch.wall_s();
        step_s += batch_s;
        batch_ms.push_back(1e3 * batch_s);
        steps += static_cast<double>(std::ranges::count(env.acted(), std::uint8_t{1}));  // those that wait for others take none
      } while (watch.wall_s() < seconds);
      if (repeat == 0) continue;
      times.steps_per_s.push_back(steps / watch.wall_s());
      times.alone_per_s.push_back(steps / step_s);
      for (std::size_t i = 0; i < kStages.size(); ++i)
        times.stage_ms[i].push_back(1e3 * (env.counters().stages.*kStages[i].seconds - before.*kStages[i].seconds) / steps);
      times.batch_ms.push_back(std::move(batch_ms));
    }
    MemorySample memory;
    read_process_memory(memory);
    times.resident_mb = memory.resident;
    times.cache_mb = static_cast<double>(scenes_->bytes()) / (1 << 20);
    return times;
  }

  [[nodiscard]] BenchJson setting(int envs, int threads) const {
    BenchJson json = {{"scene", options_.scene},
                      {"triangles", loaded_->scene->mesh().triangles.size()},
                      {"envs", envs},
                      {"agents", options_.agents},
                      {"agent_sounds", options_.agent_sounds},
                      {"threads", threads},
                      {"senses", senses_.name},
                      {"camera_px", config_.observation.camera.width_px},
                      {"camera_height_px", config_.observation.camera.height_px},
                      {"renderer", options_.renderer},
                      {"egl_device", options_.egl_device},
                      {"rir_length_s", config_.acoustics.rir_length_s},
                      {"field", config_.acoustics.field == Switch::on},
                      {"actions", options_.walk ? "walk" : "oracle"},
                      {"repeats", options_.repeats}};
    if (config_.acoustics.field == Switch::on) json["sources_s"] = sources_s_;
    return json;
  }
  [[nodiscard]] const EnvConfig& config() const { return config_; }
  [[nodiscard]] const Scene& scene() const { return *loaded_->scene; }
  /// Where episodes start: foot points.
  [[nodiscard]] std::vector<glm::vec3> places() const {
    std::vector<glm::vec3> all;
    for (const Episode& episode : set_->episodes) all.push_back(scene().to_local(episode.start_position));
    return all;
  }

 private:
  Senses senses_;
  const EnvBenchOptions& options_;
  EnvConfig config_;
  std::shared_ptr<SceneCache> scenes_;
  std::shared_ptr<const EnvScene> loaded_;
  std::shared_ptr<const EpisodeSet> set_;
  double sources_s_ = 0;
};

void add_rate(BenchReport& report, const std::string& name, const Senses& senses, int threads, const EnvBenchOptions& options) {
  const EnvBench bench(senses, options);
  report.add(name, "1/s", median_of(bench.run(options.envs, threads, options.repeats, options.seconds).steps_per_s),
             bench.setting(options.envs, threads));
}

/// Steps per second over envs and threads; a rate within 2 % of the best with fewer envs counts as best: a larger batch only makes actions
/// older.
BenchReport autotune(const EnvBenchOptions& options) {
  BenchReport report("env");
  const EnvBench bench(kAll, options);
  const int cores = std::max(1, static_cast<int>(tbb::info::default_concurrency()));
  std::vector<int> threads, envs = options.quick ? std::vector{2, 8} : std::vector{2, 4, 8, 16, 32, 64};
  for (int n = 1; n < cores; n *= 2) threads.push_back(n);
  threads.push_back(cores);
  struct Tried {
    int envs, threads;
    double steps_per_s;
  };
  std::vector<Tried> tried;
  double best = 0;
  for (const int n : threads)
    for (const int count : envs) {
      const Measured rate = median_of(bench.run(count, n, options.quick ? 1 : 3, options.quick ? 0.1 : 1).steps_per_s);
      report.add("env.autotune.steps_per_s", "1/s", rate, bench.setting(count, n));
      fmt::print("{:3} envs on {} threads: {:.0f} steps/s\n", count, n, rate.value);
      std::fflush(stdout);
      tried.push_back({count, n, rate.value});
      best = std::max(best, rate.value);
    }
  const auto good = [&](const Tried& run) { return run.steps_per_s >= 0.98 * best; };
  const Tried chosen =
      *std::ranges::min_element(tried, {}, [&](const Tried& run) { return good(run) ? run.envs * 1000 + run.threads : 1'000'000'000; });
  const BenchJson setting = bench.setting(chosen.envs, chosen.threads);
  report.add("env.autotune.best_envs", "", median_of({static_cast<double>(chosen.envs)}), setting);
  report.add("env.autotune.best_threads", "", median_of({static_cast<double>(chosen.threads)}), setting);
  fmt::print("best: envs_per_worker={} env.threads={} ({:.0f} steps/s)\n", chosen.envs, chosen.threads, chosen.steps_per_s);
  return report;
}

}  // namespace

BenchReport bench_env(const EnvBenchOptions& options) {
  require(options.envs >= 1 && options.envs <= 100'000, "--envs", options.envs, "must be in [1, 100000]");
  require(!options.agent_sounds || options.agents > 1, "--agent-sounds", true,
          "has no effect with one agent, which does not hear itself; set --agents 2 or more");
  require(options.threads >= 0 && options.threads <= 1024, "--threads", options.threads, "must be in [0, 1024]");
  if (options.autotune) return autotune(options);
  BenchReport report("env");
  const int threads = options.threads > 0 ? options.threads : 1;
  const EnvBench all(kAll, options);
  const EnvTimes times = all.run(options.envs, threads, options.repeats, options.seconds);
  const BenchJson setting = all.setting(options.envs, threads);
  report.add("env.steps_per_s", "1/s", median_of(times.steps_per_s), setting);
  for (std::size_t i = 0; i < kStages.size(); ++i)
    report.add(fmt::format("env.stage_ms.{}", kStages[i].name), "ms", median_of(times.stage_ms[i]), setting);
  for (const auto& [name, fraction] : kPercentiles) {
    std::vector<double> values;
    for (const std::vector<double>& batch_ms : times.batch_ms) values.push_back(percentile(batch_ms, fraction));
    report.add(fmt::format("env.batch_step_ms.{}", name), "ms", median_of(values), setting);
  }
  report.add("env.memory.resident_mb", "MiB", median_of({times.resident_mb}), setting);
  report.add("env.memory.cache_mb", "MiB", median_of({times.cache_mb}), setting);
  BenchJson one_thread = setting;
  one_thread["threads"] = 1;
  const BareRayRates rays = measure_bare_rays(all.scene(), all.config().observation.camera, all.places(), options.quick ? 0.1 : 2);
  report.add("env.bare_rays_per_s.camera", "1/s", median_of({rays.camera}), one_thread);
  report.add("env.bare_rays_per_s.diffuse", "1/s", median_of({rays.diffuse}), one_thread);
  const EnvBench bare(kNone, options);
  const EnvTimes bare_times = bare.run(options.envs, threads, options.repeats, options.seconds);
  const BenchJson bare_setting = bare.setting(options.envs, threads);
  report.add("env.bare_steps_per_s", "1/s", median_of(bare_times.steps_per_s), bare_setting);
  report.add("env.bare_steps_per_s.without_oracle", "1/s", median_of(bare_times.alone_per_s), bare_setting);
  if (options.quick) return report;
  if (options.threads == 0) {
    const int two = 2;
    report.add("env.two_threads.steps_per_s", "1/s", median_of(all.run(options.envs, two, options.repeats, options.seconds).steps_per_s),
               all.setting(options.envs, two));
  }
  add_rate(report, "env.no_sound.steps_per_s", kPictureOnly, threads, options);
  add_rate(report, "env.no_picture.steps_per_s", kSoundOnly, threads, options);
  return report;
}

}  // namespace earshot
