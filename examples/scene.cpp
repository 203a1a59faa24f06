// SPDX-License-Identifier: Apache-2.0
// scene [SCENE]
// The response between two random places of a scene, in three lines, and the effect plan.
#include <earshot/scene.h>

#include <cstdio>

int main(int argc, char** argv) try {
  const earshot::Scene scene(argc > 1 ? argv[1] : "house:7");
  const auto places = scene.random_positions(2, {.seed = 1});
  const earshot::Rir rir = scene.source(places[0]).render(places[1]);

  const earshot::Bounds bounds = scene.bounds();
  std::printf("%s: %zu triangles, %.1f x %.1f x %.1f m\n", scene.name().c_str(), scene.num_triangles(), bounds.upper.x - bounds.lower.x,
              bounds.upper.y - bounds.lower.y, bounds.upper.z - bounds.lower.z);
  std::printf("rir [%d, %d] at %.0f Hz\n", rir.num_channels, rir.num_samples, rir.sample_rate_hz);
  for (const earshot::EffectDecision& line : scene.plan()) std::printf("  %-16s %s\n", line.effect.c_str(), line.decision.c_str());
  for (const std::string& line : scene.warnings()) std::printf("warning: %s\n", line.c_str());
} catch (const std::exception& error) {
  std::fprintf(stderr, "scene: %s\n", error.what());
  return 1;
}
