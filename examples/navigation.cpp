// SPDX-License-Identifier: Apache-2.0
// navigation [SCENE]
// The shortest walk between two places, and a step along it.
#include <earshot/navigation.h>

#include <cmath>
#include <cstdio>

int main(int argc, char** argv) try {
  const earshot::Scene scene(argc > 1 ? argv[1] : "house:7");
  const earshot::Navigation floor(scene);
  const earshot::Vec3 from = floor.random_point(1, 0), to = floor.random_point(1, 1);
  const auto length_m = floor.distance_m(from, to);
  if (!length_m) throw earshot::InputError("navigation", "no path leads there", "take another scene");
  const auto path = floor.path(from, to);
  std::printf("%.1f m2 of floor; %.2f m on foot by %zu corners, %.2f m straight\n", floor.area_m2(), *length_m, path.size(),
              std::hypot(to.x - from.x, to.z - from.z));
  const earshot::Vec3 next = path[1];
  const double reach = std::hypot(next.x - from.x, next.z - from.z);
  const earshot::MoveResult moved = floor.move(from, {0.25 * (next.x - from.x) / reach, 0, 0.25 * (next.z - from.z) / reach});
  std::printf("a step of 0.25 m leaves %.2f m%s\n", floor.distance_m(moved.position, to).value_or(-1),
              moved.collided ? ", with a collision" : "");
} catch (const std::exception& error) {
  std::fprintf(stderr, "navigation: %s\n", error.what());
  return 1;
}
