// SPDX-License-Identifier: Apache-2.0
// train FOLDER [STEPS]
// Trains a tiny agent in an empty room and evaluates it on episodes it has not seen.  A few steps teach nothing: configs/train has configs
// that do.
#include <earshot/train.h>

#include <cstdio>
#include <string>

int main(int argc, char** argv) try {
  if (argc < 2) {
    std::fputs("usage: train FOLDER [STEPS]\n", stderr);
    return 2;
  }
  const std::string folder = argv[1];
  const auto data = [&](const char* name, int count) {
    return std::string("  ") + name + ": {file: " + folder + "/" + name +
           ".json.gz, scenes: ['shoebox:6x3x5@0.3'], sounds: ['synth:noise'], " + "episodes_per_scene: " + std::to_string(count) +
           ", filter: {min_geodesic_m: 1, min_ratio: 1}}\n";
  };
  const auto run = earshot::Config::from_text(
      "name: tiny\n"
      "seed: 3\n"
      "envs_per_worker: 2\n"
      "rollout_steps: 8\n"
      "total_steps: " +
      std::string(argc > 2 ? argv[2] : "64") +
      "\n"
      "eval_envs: 2\n"
      "out: " +
      folder +
      "/run\n"
      "env:\n"
      "  task: {max_steps: 12}\n"
      "  observation: {depth: false}\n"
      "  acoustics: {rays: 4, rir_length_s: 0.1, early_order: 0}\n"
      "policy: {hidden_size: 8, audio_features: 8, conv_channels: 2}\n"
      "data:\n" +
      data("train", 6) + data("eval", 4));
  const auto [train, eval] = earshot::write_episode_sets(run);
  std::printf("%zu episodes to train, %zu to evaluate\n", train, eval);
  const earshot::TrainReport report = earshot::train(run, {.overwrite = true});
  std::printf("%llu updates, %llu steps: %s\n", static_cast<unsigned long long>(report.updates),
              static_cast<unsigned long long>(report.env_steps), report.checkpoint.c_str());
  for (const earshot::Estimate& estimate : earshot::evaluate(report.checkpoint))
    std::printf("  %-20s %7.3f [%.3f, %.3f]\n", estimate.metric.c_str(), estimate.mean, estimate.low, estimate.high);
  for (const earshot::Estimate& estimate : earshot::evaluate_baseline("oracle", run))
    if (estimate.metric == "success") std::printf("success of the oracle %.3f\n", estimate.mean);
} catch (const std::exception& error) {
  std::fprintf(stderr, "train: %s\n", error.what());
  return 1;
}
