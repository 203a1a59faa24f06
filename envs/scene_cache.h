#pragma once

#include <cstdint>
#include <filesystem>
#include <glm/vec3.hpp>
#include <memory>
#include <string>

#include "sim/acoustics/model/acoustic_scene.h"
#include "sim/acoustics/paths/early_reflections.h"
#include "sim/acoustics/source_field/source_field_store.h"
#include "sim/nav/geodesic_field.h"
#include "sim/nav/navmesh.h"

namespace earshot {

/// A scene with its acoustics and navmesh.  Immutable, shared.
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
  std::shared_ptr<const SourceField> sound_field;  ///< late sound, refined to its target; null: the path tracer finds it at each pose
};

/// Loads scenes and sources once and keeps the most recently used ones within a bound on bytes: of scenes, estimated from triangle counts,
/// and of sources, estimated from their paths, with their sound fields.  Thread-safe; two threads that request the same scene wait for one
/// load.  A held pointer keeps its scene or source, evicted or not.
class SceneCache {
 public:
  /// acoustics.field: `on` keeps a field with each source.  `automatic` plans scenes without and traces: an episode has 50 to 150 poses,
  /// for which photons cost as much as 64 rays at each, and only with fields do walls let late sound through.  `on` pays where agents,
  /// episodes, workers or runs share a source, or where its lower error is wanted.
  /// fields: folder and bound of the sound fields that runs and processes share; its memory bound is not used here, and its warnings are
  /// logged.
  SceneCache(const AcousticConfig& acoustics, const NavmeshConfig& navmesh, std::filesystem::path scene_root, std::size_t max_bytes,
             FieldStoreConfig fields = {});
  ~SceneCache();
  /// scene_id: a SCENE; a relative mesh or YAML path is looked up under scene_root first.  Throws InputError.
  std::shared_ptr<const EnvScene> scene(const std::string& scene_id);
  /// goal: foot point under the sound source, in the coordinates of the scene's file (Scene::to_local).
  std::shared_ptr<const EnvSource> source(const std::string& scene_id, glm::dvec3 goal, float source_height_m);
  /// Loads the same in a background thread, so that source() finds it.  Returns at once; errors wait for source().
  void prefetch(const std::string& scene_id, glm::dvec3 goal, float source_height_m);

  [[nodiscard]] const AcousticConfig& acoustics() const;
  [[nodiscard]] std::size_t num_scenes() const;       ///< held now
  [[nodiscard]] std::uint64_t scenes_loaded() const;  ///< since construction
  [[nodiscard]] std::uint64_t sources_built() const;
  [[nodiscard]] std::size_t bytes() const;  ///< held now, by the measure of the bound
  /// Sound fields built and read since construction.
  [[nodiscard]] FieldCounters field_counters() const;

 private:
  struct Impl;
  std::unique_ptr<Impl> impl_;
};

}  // namespace earshot
