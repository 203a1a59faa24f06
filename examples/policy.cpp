// SPDX-License-Identifier: Apache-2.0
// policy POLICY [STEPS]
// Lets a trained agent look for the sound in houses that it has not seen, and counts its successes.
#include <earshot/policy.h>

#include <cstdio>
#include <cstdlib>

int main(int argc, char** argv) try {
  if (argc < 2) {
    std::fputs("usage: policy POLICY [STEPS]\n", stderr);
    return 2;
  }
  const int steps = argc > 2 ? std::atoi(argv[2]) : 200;
  const auto policy = earshot::Policy::load(argv[1]);
  std::printf("%s%lld parameters\n", policy.description().c_str(), static_cast<long long>(policy.num_parameters()));

  const auto episodes = earshot::EpisodeSet::generate({.scenes = {"house:3000..3001,rooms=3,area_m2=36"},
                                                       .sounds = {"synth:telephone:100"},
                                                       .episodes_per_scene = 4,
                                                       .settings = {{"filter.min_geodesic_m", 1.5}, {"filter.min_ratio", 1}}});
  earshot::VectorEnv envs(earshot::Config::from_text(policy.config_text()), episodes, 4, {.settings = {{"threads", 0}}});
  earshot::Agent agent(policy, envs, {.sample = false});
  envs.reset();
  int ended = 0, reached = 0;
  for (int step = 0; step < steps; ++step) {
    envs.step(agent.act());
    agent.observe_step();
    for (const earshot::EpisodeResult& episode : envs.finished()) {
      ++ended;
      reached += episode.success > 0;
    }
  }
  std::printf("%d steps of %d envs: %d episodes ended, %d goals reached\n", steps, envs.num_envs(), ended, reached);
} catch (const std::exception& error) {
  std::fprintf(stderr, "policy: %s\n", error.what());
  return 1;
}
