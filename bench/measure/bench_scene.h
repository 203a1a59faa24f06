// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <glm/vec3.hpp>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "sim/nav/navmesh.h"
#include "sim/scene/scene.h"

namespace earshot {

/// A point between the ears and the heading of the listener.
struct WalkPose {
  glm::vec3 foot{0};  ///< on the walkable surface
  double heading_rad = 0;
  [[nodiscard]] glm::vec3 ears() const { return foot + glm::vec3(0, 1.5f, 0); }
};

/// A scene as the benchmarks use it: one source, and a walk of 15 m in steps of 0.15 m between points with free air about them.
struct BenchScene {
  std::string name, spec;
  std::shared_ptr<const Scene> scene;
  std::shared_ptr<const Navmesh> navmesh;
  glm::vec3 source_foot{0};
  std::vector<WalkPose> walk;

  [[nodiscard]] glm::vec3 source() const { return source_foot + glm::vec3(0, 1.5f, 0); }
  /// `count` poses of the walk, evenly spread from the first to the last.
  [[nodiscard]] std::vector<WalkPose> some_poses(int count) const;
};

/// name: in tables and file names.  The walk is a function of (name, spec, seed).  Throws InputError as load_scene.
BenchScene load_bench_scene(const std::string& name, const std::string& spec, std::uint64_t seed = 1);

/// Walks from point to point along shortest paths, `step_m` at a time, until there are `count` poses; heading: where it goes.
std::vector<WalkPose> walk_between(const Navmesh& navmesh, const std::vector<glm::vec3>& points, float step_m, int count);

/// Scenes of the benchmarks: name and SCENE.
struct SceneName {
  std::string name, spec;
};
inline constexpr const char* kLargeHouse = "house:7,rooms=8,area_m2=140,detail_m=0.12";  ///< at least 150,000 triangles (test)
/// A file of the repository in the working folder or, failing that, where the sources were built; nullopt if it is in neither.
std::optional<std::string> source_file(const std::string& path);
/// A file of configs/scenes in the working folder or, failing that, beside the sources.  nullopt, and a line on stderr, if the file or the
/// mesh that it names is absent: the public data set is not part of the repository.
std::optional<SceneName> scene_file(const std::string& name, const std::string& file);

}  // namespace earshot
