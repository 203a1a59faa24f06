// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <filesystem>
#include <functional>
#include <memory>
#include <string>

#include "envs/scenes/env_scene.h"
#include "sim/acoustics/core/acoustic_config.h"
#include "sim/nav/navmesh.h"

namespace earshot {

struct SceneStoreConfig {
  std::filesystem::path folder;              ///< shared by threads, processes and runs; empty: nothing is kept on disk
  std::uint64_t max_bytes = 20'000'000'000;  ///< in that folder (image_store.h says how exactly)
  /// Damaged files, a folder that cannot be written, and what is odd about a scene that is built (scene_check.h); empty: silent.
  std::function<void(const std::string&)> warn;
};

/// Where scenes came from, since construction.
struct SceneStoreCounters {
  std::uint64_t built = 0, read = 0;  ///< read: all three parts were in the folder
  std::uint64_t bytes_read = 0;
  double build_seconds = 0, read_seconds = 0;  ///< wall time, summed over threads; building includes writing
};

/// Preprocessed scenes in a folder: repaired mesh with its flat patches and materials, planes, edges and effect plan, navmesh.  Three files
/// for each, so that scenes under several acoustic or navmesh configs share what these do not change.  A name is the hash of
/// everything that decides the content, the commit of the engine and its build included (of a build with local changes, the very program):
/// files of other inputs or engines are never read, and go as the least recently used.  Bits do not depend on where a scene comes from.
/// A damaged file counts as missing, with one warning.  Of processes that need the same scene at once one makes it, the others wait for it
/// and read it.  Thread-safe.
///
/// A scene of 342,000 triangles (kLargeHouse of bench/measure/bench_scene.h) takes 15 MB; docs/howto/scenes_at_scale.md has the time of
/// a load.
class SceneStore {
 public:
  explicit SceneStore(SceneStoreConfig config);
  ~SceneStore();

  /// As load_scene(spec), AcousticScene and Navmesh.  Throws what these throw; never for what is in the folder.
  EnvScene load(const std::string& spec, const AcousticConfig& acoustics, const NavmeshConfig& navmesh);
  [[nodiscard]] SceneStoreCounters counters() const;

 private:
  struct Impl;
  std::unique_ptr<Impl> impl_;
};

}  // namespace earshot
