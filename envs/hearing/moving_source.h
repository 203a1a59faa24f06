// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <glm/vec3.hpp>
#include <memory>
#include <vector>

#include "envs/scenes/env_scene.h"
#include "sim/acoustics/paths/early_reflections.h"

namespace earshot {

/// Where a moving source is, in the coordinates of the engine.
struct TimedPlace {
  double sample = 0;  ///< of the stream
  glm::vec3 position{0};
};

/// A source that moves: along a path, or carried by an agent.  The candidates of a place are made once, for all that listen.
class MovingSource {
 public:
  /// path: by rising samples; empty: its carrier states the position.  home: its position before it moves.
  MovingSource(std::shared_ptr<const EnvScene> scene, glm::vec3 home, std::vector<TimedPlace> path = {})
      : scene_(std::move(scene)), home_(home), path_(std::move(path)) {}

  /// The place on the path at a sample of the stream; at rest before its first place and after its last.
  [[nodiscard]] glm::vec3 place_at(double sample) const;
  [[nodiscard]] bool has_path() const { return !path_.empty(); }
  /// Puts it there.  Costs the candidates (EarlyCandidates, a source that moves) unless it has not moved by a bit.  While it runs none may
  /// listen.
  void move_to(glm::vec3 place);

  [[nodiscard]] const std::shared_ptr<const EnvScene>& scene() const { return scene_; }
  [[nodiscard]] glm::vec3 home() const { return home_; }
  /// Of where it is; not before the first move_to().
  [[nodiscard]] const EarlyCandidates& candidates() const { return *candidates_; }

 private:
  std::shared_ptr<const EnvScene> scene_;
  glm::vec3 home_;
  std::vector<TimedPlace> path_;
  std::unique_ptr<const EarlyCandidates> candidates_;
};

}  // namespace earshot
