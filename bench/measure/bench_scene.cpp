// SPDX-License-Identifier: Apache-2.0
#include "bench/measure/bench_scene.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <filesystem>
#include <glm/geometric.hpp>

#include "envs/episodes/episode_generator.h"
#include "sim/base/errors.h"
#include "sim/nav/geodesic_field.h"
#include "sim/scene/scene_config.h"

namespace earshot {
namespace {

constexpr float kStepM = 0.15f;
constexpr int kSteps = 100;

float level_distance(glm::vec3 a, glm::vec3 b) { return std::hypot(b.x - a.x, b.z - a.z); }

}  // namespace

std::vector<WalkPose> BenchScene::some_poses(int count) const {
  std::vector<WalkPose> poses;
  const std::size_t last = walk.size() - 1;
  const auto n = static_cast<std::size_t>(std::clamp(count, 1, static_cast<int>(walk.size())));
  for (std::size_t i = 0; i < n; ++i) poses.push_back(walk[n == 1 ? 0 : (i * last + (n - 1) / 2) / (n - 1)]);
  return poses;
}

std::vector<WalkPose> walk_between(const Navmesh& navmesh, const std::vector<glm::vec3>& points, float step_m, int count) {
  std::vector<WalkPose> walk;
  if (points.empty() || count <= 0) return walk;
  const auto full = [&] { return static_cast<int>(walk.size()) >= count; };
  walk.push_back({points.front(), 0});
  for (std::size_t next = 1; !full(); next = (next + 1) % points.size()) {
    const GeodesicField field(navmesh, points[next]);
    glm::vec3 at = walk.back().foot;
    if (!field.distance_m(at)) continue;
    const std::size_t before = walk.size();
    while (!full()) {
      double heading_rad = walk.back().heading_rad;
      float left_m = step_m;
      while (left_m > 1e-4f && level_distance(at, field.goal()) > 1e-3f) {
        const auto corner = field.next_corner(at);
        const float to_corner_m = corner ? level_distance(at, *corner) : 0.f;
        if (!corner || to_corner_m < 1e-5f) break;
        heading_rad = std::atan2(-(corner->x - at.x), -(corner->z - at.z));
        const float fraction = std::min(left_m / to_corner_m, 1.f);
        const glm::vec3 moved = at + fraction * (*corner - at);
        at = navmesh.snap(moved, 0.1f).value_or(moved);
        left_m -= fraction * to_corner_m;
      }
      if (left_m > 0.5f * step_m) break;  // at the point, or stuck
      walk.push_back({at, heading_rad});
    }
    if (walk.size() == before && next == 0) break;  // once round without a step: all points are one
  }
  if (walk.size() > 1) walk.front().heading_rad = walk[1].heading_rad;
  return walk;
}

BenchScene load_bench_scene(const std::string& name, const std::string& spec, std::uint64_t seed) {
  BenchScene bench;
  bench.name = name;
  bench.spec = spec;
  bench.scene = std::make_shared<const Scene>(load_scene(spec));
  bench.navmesh = std::make_shared<const Navmesh>(bench.scene->mesh(), NavmeshConfig{});
  const EpisodeFilter anywhere{.min_geodesic_m = 0.5f, .max_geodesic_m = 100.f, .min_ratio = 1.f, .max_tries = 1000};
  constexpr int num_points = 12;
  const auto episodes = generate_episodes(name, *bench.scene, *bench.navmesh,
                                          {.filter = anywhere, .sounds = {"synth:speech"}, .count = num_points, .seed = seed});
  bench.source_foot = bench.scene->to_local(episodes.front().goal_position);
  std::vector<glm::vec3> points;
  for (const Episode& episode : episodes) points.push_back(bench.scene->to_local(episode.start_position));
  bench.walk = walk_between(*bench.navmesh, points, kStepM, kSteps + 1);
  // On top of the source the direct sound dominates, and its level has no bound.
  std::erase_if(bench.walk, [&](const WalkPose& pose) { return level_distance(pose.foot, bench.source_foot) < 0.3f; });
  if (bench.walk.size() < 10) throw InputError(spec, "is too small for a walk", "use a scene with more free floor");
  return bench;
}

std::optional<std::string> source_file(const std::string& path) {
  for (const std::filesystem::path& root : {std::filesystem::path("."), std::filesystem::path(EARSHOT_SOURCE_DIR)})
    if (std::filesystem::exists(root / path)) return (root / path).lexically_normal().string();
  return std::nullopt;
}

std::optional<SceneName> scene_file(const std::string& name, const std::string& file) {
  const std::optional<std::string> path = source_file("configs/scenes/" + file);
  if (!path) {
    fmt::print(stderr, "bench: {} is left out: configs/scenes/{} is missing\n", name, file);
    return std::nullopt;
  }
  const SceneConfig config = read_scene_config(*path);
  if (std::filesystem::exists(config.mesh)) return SceneName{name, *path};
  fmt::print(stderr, "bench: {} is left out: its mesh {} is missing\n", name, config.mesh);
  return std::nullopt;
}

}  // namespace earshot
