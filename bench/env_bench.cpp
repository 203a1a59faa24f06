// Question: how many agent steps per second does one core give, and which stage takes them?
#include <benchmark/benchmark.h>

#include "envs/baselines.h"
#include "envs/batched_env.h"
#include "envs/episode_generator.h"

namespace earshot {
namespace {

enum Sensors { all_sensors, no_sound, no_picture, bare };

void BM_EnvStep(benchmark::State& state) {
  EnvConfig config;
  config.observation.camera.width_px = config.observation.camera.height_px = 64;
  config.observation.pointgoal = true;
  const auto sensors = static_cast<Sensors>(state.range(0));
  config.observation.spectrogram = sensors == all_sensors || sensors == no_picture;
  config.observation.depth = sensors == all_sensors || sensors == no_sound;
  config.threads = static_cast<int>(state.range(1));
  const std::string id = "house:1,rooms=3";
  const auto scenes = make_scene_cache(config);
  const auto loaded = scenes->scene(id);
  EpisodeSet set;
  set.episodes = generate_episodes(id, *loaded->scene, loaded->navmesh, config.task, {}, {"synth:telephone", "synth:music"}, 32, 1);
  const int envs = 8;
  BatchedEnv env(config, std::make_shared<const EpisodeSet>(std::move(set)), scenes, envs);
  env.reset();
  const StageSeconds start = env.stage_seconds();
  std::vector<std::int32_t> actions(envs);
  // The oracle's mix of turns and moves, ends of episodes included, is close to what a trained policy asks for.
  for (auto _ : state) {
    baseline_actions(Baseline::oracle, env, 0, 0, actions);
    env.step(actions);
  }
  const StageSeconds end = env.stage_seconds();
  const double steps = static_cast<double>(state.iterations()) * envs;
  state.counters["steps_per_s"] = benchmark::Counter(steps, benchmark::Counter::kIsRate);
  const auto stage_ms = [&](double before, double after) { return 1e3 * (after - before) / steps; };
  state.counters["move_ms"] = stage_ms(start.move, end.move);
  state.counters["trace_ms"] = stage_ms(start.trace, end.trace);
  state.counters["synthesize_ms"] = stage_ms(start.synthesize, end.synthesize);
  state.counters["convolve_ms"] = stage_ms(start.convolve, end.convolve);
  state.counters["render_ms"] = stage_ms(start.render, end.render);
  state.counters["observe_ms"] = stage_ms(start.observe, end.observe);
  state.counters["reset_ms"] = stage_ms(start.reset, end.reset);
}
BENCHMARK(BM_EnvStep)
    ->ArgNames({"sensors", "threads"})
    ->Args({all_sensors, 1})
    ->Args({all_sensors, 2})
    ->Args({no_sound, 1})
    ->Args({no_picture, 1})
    ->Args({bare, 1})
    ->Unit(benchmark::kMillisecond)
    ->UseRealTime();

}  // namespace
}  // namespace earshot
