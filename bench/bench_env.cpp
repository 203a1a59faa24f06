#include "bench/bench_env.h"

#include <fmt/format.h>

#include <array>

#include "envs/baselines.h"
#include "envs/batched_env.h"
#include "envs/episode_generator.h"
#include "sim/base/stopwatch.h"

namespace earshot {
namespace {

constexpr int kEnvs = 8;
constexpr const char* kScene = "house:1,rooms=3";

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

struct EnvTimes {
  std::vector<double> steps_per_s;
  std::array<std::vector<double>, kStages.size()> stage_ms;
};

EnvTimes time_steps(const Senses& senses, int threads, const EnvBenchOptions& options) {
  EnvConfig config;
  config.observation.spectrogram = senses.sound;
  config.observation.depth = senses.picture;
  config.observation.pointgoal = true;
  config.threads = threads;
  const auto scenes = make_scene_cache(config);
  const auto loaded = scenes->scene(kScene);
  EpisodeSet set;
  set.episodes = generate_episodes(kScene, *loaded->scene, loaded->navmesh, config.task, {}, {"synth:telephone", "synth:music"}, 32, 1);
  BatchedEnv env(config, std::make_shared<const EpisodeSet>(std::move(set)), scenes, kEnvs);
  env.reset();
  EnvTimes times;
  std::vector<std::int32_t> actions(kEnvs);
  for (int repeat = 0; repeat <= options.repeats; ++repeat) {  // the first warms up: sources are built on the way
    const StageSeconds before = env.stage_seconds();
    const Stopwatch watch;
    double steps = 0;
    do {
      // The oracle's mix of turns and moves, ends of episodes included, is close to that of a trained policy.
      baseline_actions(Baseline::oracle, env, 0, 0, actions);
      env.step(actions);
      steps += kEnvs;
    } while (watch.wall_s() < options.seconds);
    if (repeat == 0) continue;
    times.steps_per_s.push_back(steps / watch.wall_s());
    for (std::size_t i = 0; i < kStages.size(); ++i)
      times.stage_ms[i].push_back(1e3 * (env.stage_seconds().*kStages[i].seconds - before.*kStages[i].seconds) / steps);
  }
  return times;
}

BenchJson setting_of(const Senses& senses, int threads, const EnvBenchOptions& options) {
  const EnvConfig config;
  return {{"scene", kScene},
          {"envs", kEnvs},
          {"threads", threads},
          {"senses", senses.name},
          {"camera_px", config.observation.camera.width_px},
          {"rir_length_s", config.acoustics.rir_length_s},
          {"actions", "oracle"},
          {"repeats", options.repeats}};
}

}  // namespace

BenchReport bench_env(const EnvBenchOptions& options) {
  BenchReport report("env");
  const EnvTimes one = time_steps(kAll, 1, options);
  report.add("env.steps_per_s", "1/s", median_of(one.steps_per_s), setting_of(kAll, 1, options));
  for (std::size_t i = 0; i < kStages.size(); ++i)
    report.add(fmt::format("env.stage_ms.{}", kStages[i].name), "ms", median_of(one.stage_ms[i]), setting_of(kAll, 1, options));
  report.add("env.bare_steps_per_s", "1/s", median_of(time_steps(kNone, 1, options).steps_per_s), setting_of(kNone, 1, options));
  if (options.quick) return report;
  report.add("env.two_threads.steps_per_s", "1/s", median_of(time_steps(kAll, 2, options).steps_per_s), setting_of(kAll, 2, options));
  report.add("env.no_sound.steps_per_s", "1/s", median_of(time_steps(kPictureOnly, 1, options).steps_per_s),
             setting_of(kPictureOnly, 1, options));
  report.add("env.no_picture.steps_per_s", "1/s", median_of(time_steps(kSoundOnly, 1, options).steps_per_s),
             setting_of(kSoundOnly, 1, options));
  return report;
}

}  // namespace earshot
