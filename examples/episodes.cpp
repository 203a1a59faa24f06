// SPDX-License-Identifier: Apache-2.0
// episodes OUT.json.gz
// Draws navigation episodes, writes them, reads them again and steps through one.
#include <earshot/env.h>
#include <earshot/episodes.h>

#include <cstdio>

int main(int argc, char** argv) try {
  if (argc != 2) {
    std::fputs("usage: episodes OUT.json.gz\n", stderr);
    return 2;
  }
  const auto drawn = earshot::EpisodeSet::generate(
      {.scenes = {"house:1000..1001,rooms=3,area_m2=36"}, .episodes_per_scene = 3, .seed = 5, .settings = {{"filter.min_geodesic_m", 2}}});
  drawn.save(argv[1]);
  const auto read = earshot::EpisodeSet::load(argv[1]);
  for (std::size_t i = 0; i < read.size(); ++i) {
    const earshot::Episode episode = read[i];
    std::printf("%zu  %-34s %-16s %5.2f m, %d actions\n", i, episode.scene.c_str(), episode.sound.c_str(), episode.distance_m,
                episode.oracle_actions);
  }
  std::printf("%zu episodes, read back %s\n", read.size(), read.hash() == drawn.hash() ? "equal" : "different");

  earshot::VectorEnv envs(earshot::Config::from_text("acoustics: {field: off}"), read, 1);
  envs.reset();
  std::printf("the first env begins in %s\n", envs.scene_name(0).c_str());
} catch (const std::exception& error) {
  std::fprintf(stderr, "episodes: %s\n", error.what());
  return 1;
}
