// SPDX-License-Identifier: Apache-2.0
// camera OUT.png [SCENE]
// What an agent sees: colours as a PNG file, the nearest and farthest depth, and the categories in view.
#include <earshot/camera.h>
#include <earshot/navigation.h>

#include <algorithm>
#include <cstdio>
#include <set>

int main(int argc, char** argv) try {
  if (argc < 2) {
    std::fputs("usage: camera OUT.png [SCENE]\n", stderr);
    return 2;
  }
  const earshot::Scene scene(argc > 2 ? argv[2] : "house:7");
  const earshot::Camera camera(scene, {.width_px = 160, .height_px = 120, .max_depth_m = 20});
  const earshot::Vec3 foot = earshot::Navigation(scene).random_point(1);
  const earshot::Pictures seen = camera.render(foot, 30, {.depth = true, .rgb = true, .semantic = true});
  earshot::write_rgb_png(argv[1], seen);

  const auto [nearest, farthest] = std::minmax_element(seen.depth.begin(), seen.depth.end());
  std::printf("%d x %d pixels, depth %.2f to %.2f m\n", seen.width_px, seen.height_px, *nearest * camera.options().max_depth_m,
              *farthest * camera.options().max_depth_m);
  for (const std::uint16_t category : std::set<std::uint16_t>(seen.semantic.begin(), seen.semantic.end()))
    std::printf("  %s\n", earshot::semantic_categories()[category].c_str());
} catch (const std::exception& error) {
  std::fprintf(stderr, "camera: %s\n", error.what());
  return 1;
}
