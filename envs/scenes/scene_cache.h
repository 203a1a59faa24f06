// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <filesystem>
#include <glm/vec3.hpp>
#include <memory>
#include <string>

#include "envs/scenes/env_scene.h"
#include "envs/scenes/scene_store.h"
#include "sim/acoustics/paths/early_reflections.h"
#include "sim/acoustics/source_field/source_field_store.h"
#include "sim/nav/geodesic_field.h"

namespace earshot {

/// Argument of load_scene for a scene of an episode: below scene_root if its name, or that up to a comma, is a file there, else as it is.
std::string resolve_scene(const std::string& scene_id, const std::filesystem::path& scene_root);

/// Data of one goal in one scene, shared by agents and episodes.  Holds the scene alive.
struct EnvSource {
  std::shared_ptr<const EnvScene> scene;
  GeodesicField field;
  EarlyCandidates candidates;
  std::shared_ptr<const SourceField> sound_field;  ///< late sound, refined to its target; null: the path tracer finds it at each pose
};

/// Loads scenes and sources once and keeps the most recently used ones within a bound on bytes: of scenes, counted (EnvScene::bytes), and
/// of sources, estimated from their paths, with their sound fields.  Thread-safe; two threads that request the same scene wait for one
/// load.
///
/// A held pointer keeps its scene or source.  Entries held outside are never evicted: that would free nothing, and the next request would
/// load them twice.  They count towards the bound, and other entries are evicted.  So the bound holds as far as what is held outside fits
/// in it: the scenes of running
/// episodes and their goals.
class SceneCache {
 public:
  /// acoustics.field: `on` keeps a field with each source.  `automatic` plans scenes without and traces: a cache does not know how many
  /// poses share a source, which decides what is cheaper; choose_field (field_choice.h) does, from a set of episodes.
  /// fields: folder and bound of the sound fields that runs and processes share; its memory bound is not used here, and its warnings are
  /// logged.  scenes: the same of preprocessed scenes.
  SceneCache(const AcousticConfig& acoustics, const NavmeshConfig& navmesh, std::filesystem::path scene_root, std::size_t max_bytes,
             FieldStoreConfig fields = {}, SceneStoreConfig scenes = {});
  ~SceneCache();
  /// scene_id: a SCENE; a relative mesh or YAML path is looked up under scene_root first.  Throws InputError.
  std::shared_ptr<const EnvScene> scene(const std::string& scene_id);
  /// goal: foot point under the sound source, in the coordinates of the scene's file (Scene::to_local).
  std::shared_ptr<const EnvSource> source(const std::string& scene_id, glm::dvec3 goal, float source_height_m);
  /// Loads the same in a background thread, so that source() finds it.  Returns at once; errors wait for source().
  void prefetch(const std::string& scene_id, glm::dvec3 goal, float source_height_m);

  /// Whether what prefetch() asked for is not yet loaded.  From any thread, without a lock.
  [[nodiscard]] bool loads_ahead() const;

  [[nodiscard]] const AcousticConfig& acoustics() const;
  [[nodiscard]] std::size_t num_scenes() const;       ///< held now
  [[nodiscard]] std::uint64_t scenes_loaded() const;  ///< since construction
  [[nodiscard]] std::uint64_t sources_built() const;
  /// Bytes held, as counted for the bound; includes entries that another thread acquired during their eviction.
  [[nodiscard]] std::size_t bytes() const;
  [[nodiscard]] std::size_t held_bytes() const;  ///< part of them that is held outside and cannot be evicted
  /// Sound fields built and read since construction.
  [[nodiscard]] FieldCounters field_counters() const;
  /// Scenes built and read from the folder since construction.
  [[nodiscard]] SceneStoreCounters scene_store_counters() const;

 private:
  struct Impl;
  std::unique_ptr<Impl> impl_;
};

}  // namespace earshot
