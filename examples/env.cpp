// SPDX-License-Identifier: Apache-2.0
// env [SCENE [STEPS]]
// Steps four agents together with actions in turn, and prints what they observe and the rewards.
#include <earshot/env.h>

#include <cstdio>
#include <cstdlib>

int main(int argc, char** argv) try {
  const std::string scene = argc > 1 ? argv[1] : "house:7";
  const int steps = argc > 2 ? std::atoi(argv[2]) : 20;
  const auto config = earshot::Config::from_text(
      "task: {max_steps: 100}\n"
      "observation: {collision: true}\n"
      "acoustics: {preset: fast, field: off}\n"
      "episodes: {scenes: ['" +
      scene + "'], sounds: ['synth:telephone', 'synth:music'], episodes_per_scene: 8}\n");
  earshot::VectorEnv envs(config, 4, {.settings = {{"threads", 0}}});  // any number of threads gives the same bits
  envs.reset();
  for (const earshot::SensorInfo& sensor : envs.sensors()) {
    std::printf("%-12s [%d", sensor.name.c_str(), envs.num_rows());
    for (const int size : sensor.shape) std::printf(", %d", size);
    std::printf("] %s\n", sensor.units.c_str());
  }
  std::vector<std::int32_t> actions(static_cast<std::size_t>(envs.num_rows()));
  for (int step = 0; step < steps; ++step) {
    for (int env = 0; env < envs.num_rows(); ++env) actions[static_cast<std::size_t>(env)] = 1 + (step + env) % 3;  // anything but stop
    envs.step(actions);
    std::printf("step %2d  rewards", step);
    for (const float reward : envs.rewards()) std::printf(" %7.3f", static_cast<double>(reward));
    std::printf("  nearest depth %.3f\n", static_cast<double>(envs.rows_as<float>("depth")[0]));
  }
} catch (const std::exception& error) {
  std::fprintf(stderr, "env: %s\n", error.what());
  return 1;
}
