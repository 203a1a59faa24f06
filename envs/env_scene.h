#pragma once

#include <cstddef>
#include <memory>

#include "sim/acoustics/model/acoustic_scene.h"
#include "sim/nav/navmesh.h"

namespace earshot {

/// A scene with its acoustics and navmesh.  Immutable, shared.
struct EnvScene {
  std::shared_ptr<const Scene> scene;
  AcousticScene acoustics;
  Navmesh navmesh;

  /// Of memory that it holds now; what is found on demand makes it grow.
  [[nodiscard]] std::size_t bytes() const { return scene->bytes() + acoustics.bytes() + navmesh.bytes(); }
};

}  // namespace earshot
