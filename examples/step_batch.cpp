// step_batch [SCENE [STEPS]]
// Steps four agents together with random actions, and prints what they observe and the rewards.
#include <cstdio>
#include <cstdlib>
#include <exception>
#include <memory>
#include <vector>

#include "envs/batch/batched_env.h"
#include "envs/episodes/episode_generator.h"
#include "sim/base/random.h"

using namespace earshot;

int main(int argc, char** argv) try {
  const std::string scene = argc > 1 ? argv[1] : "house:7";
  const int steps = argc > 2 ? std::atoi(argv[2]) : 20;
  constexpr int num_envs = 4;

  EnvConfig config;
  config.threads = 0;  // all cores; any number gives the same bits
  const std::shared_ptr<SceneCache> scenes = make_scene_cache(config);
  const std::shared_ptr<const EnvScene> loaded = scenes->scene(scene);
  EpisodeSet set;
  set.episodes = generate_episodes(scene, *loaded->scene, loaded->navmesh,
                                   {.task = config.task, .sounds = {"synth:telephone", "synth:music"}, .count = 8, .seed = 1});
  BatchedEnv env(config, std::make_shared<const EpisodeSet>(std::move(set)), scenes, num_envs);
  env.reset();

  const ObservationSpec& spec = env.config().observation;
  std::printf("depth       [%d, %d, %d, 1]\n", num_envs, spec.camera.height_px, spec.camera.width_px);
  std::printf("spectrogram [%d, %d, %d, 2]\n", num_envs, spec.sound.rows(), spec.sound.columns());

  std::vector<std::int32_t> actions(num_envs);
  for (int step = 0; step < steps; ++step) {
    for (int e = 0; e < num_envs; ++e) {
      const RandomStream random(1, Purpose::random_agent, static_cast<std::uint32_t>(e), static_cast<std::uint32_t>(step));
      actions[e] = 1 + static_cast<std::int32_t>(random.below(kNumActions - 1, 0));  // anything but stop, which ends an episode
    }
    env.step(actions);
    std::printf("step %2d  rewards", step);
    for (const float reward : env.rewards()) std::printf(" %7.3f", reward);
    std::printf("\n");
  }
} catch (const std::exception& error) {
  std::fprintf(stderr, "step_batch: %s\n", error.what());
  return 1;
}
