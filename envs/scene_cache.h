#pragma once

#include <cstdint>
#include <filesystem>
#include <memory>
#include <string>

#include "sim/acoustics/acoustic_scene.h"
#include "sim/acoustics/early_reflections.h"
#include "sim/nav/geodesic_field.h"
#include "sim/nav/navmesh.h"

namespace earshot {

/// A scene with all that environments need of it.  Immutable, shared.
struct EnvScene {
  std::shared_ptr<const Scene> scene;
  AcousticScene acoustics;
  Navmesh navmesh;
};

/// What belongs to one goal in one scene: shared by agents and episodes.  Holds the scene alive.
struct EnvSource {
  std::shared_ptr<const EnvScene> scene;
  GeodesicField field;
  EarlyCandidates candidates;
};

/// Loads scenes once and keeps the most recently used ones within a bound on bytes (estimated from triangle counts).  Thread-safe;
/// two threads that ask for the same scene wait for one load.
class SceneCache {
 public:
  SceneCache(const AcousticConfig& acoustics, const NavmeshConfig& navmesh, std::filesystem::path scene_root, std::size_t max_bytes);
  ~SceneCache();
  /// scene_id: a SCENE; a relative mesh or YAML path is looked up under scene_root first.  Throws InputError.
  std::shared_ptr<const EnvScene> scene(const std::string& scene_id);
  /// source: position of the sound source; goal: foot point.
  std::shared_ptr<const EnvSource> source(const std::string& scene_id, glm::vec3 goal, float source_height_m);

 private:
  struct Impl;
  std::unique_ptr<Impl> impl_;
};

}  // namespace earshot
