// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <atomic>
#include <cstddef>
#include <memory>
#include <mutex>

#include "sim/acoustics/model/acoustic_scene.h"
#include "sim/nav/navmesh.h"
#include "sim/nav/walkable_map.h"
#include "sim/scene/appearance.h"

namespace earshot {

/// Appearance of a scene, read at the first use.  Thread-safe.
class SceneLooks {
 public:
  /// Throws InputError as load_appearance; the next call tries again.
  [[nodiscard]] std::shared_ptr<const Appearance> of(const Scene& scene);
  /// Of memory that it holds now.
  [[nodiscard]] std::size_t bytes() const { return bytes_; }

 private:
  std::once_flag once_;
  std::shared_ptr<const Appearance> appearance_;
  std::atomic<std::size_t> bytes_{0};
};

/// Walkable surface seen from above, drawn at the first use.  Thread-safe.
class SceneFloor {
 public:
  [[nodiscard]] const WalkableMap& of(const Navmesh& navmesh);
  /// Of memory that it holds now.
  [[nodiscard]] std::size_t bytes() const { return bytes_; }

 private:
  std::once_flag once_;
  std::unique_ptr<const WalkableMap> map_;
  std::atomic<std::size_t> bytes_{0};
};

/// A scene with its acoustics and navmesh.  Immutable, shared.
struct EnvScene {
  std::shared_ptr<const Scene> scene;
  AcousticScene acoustics;
  Navmesh navmesh;
  std::shared_ptr<SceneLooks> looks = std::make_shared<SceneLooks>();
  std::shared_ptr<SceneFloor> floor = std::make_shared<SceneFloor>();

  /// Bytes of memory held; grows with data computed on demand.
  [[nodiscard]] std::size_t bytes() const { return scene->bytes() + acoustics.bytes() + navmesh.bytes() + looks->bytes() + floor->bytes(); }
};

}  // namespace earshot
