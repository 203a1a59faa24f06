// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstddef>
#include <glm/gtc/quaternion.hpp>
#include <glm/vec3.hpp>
#include <map>
#include <memory>
#include <string>
#include <utility>
#include <vector>

#include "compat/context_settings.h"
#include "sim/acoustics/metrics/room_metrics.h"
#include "sim/acoustics/model/acoustic_scene.h"
#include "sim/acoustics/response/energy_response.h"
#include "sim/acoustics/response/temporal_reuse.h"
#include "sim/acoustics/source_field/field_for_poses.h"
#include "sim/acoustics/synthesis/rir_synthesis.h"

namespace earshot::compat {

/// What responses of a source share in the scene where it stands.
struct SourcePaths {
  std::shared_ptr<const EarlyCandidates> candidates = nullptr;
  std::shared_ptr<const SourceField> field = nullptr;  ///< null until so many listeners hear it that it pays
};

/// A source of the caller, in metres of the world, with its image paths in the scene where they were last needed.
struct PlacedSource {
  glm::dvec3 position{0};
  float radius_m = 0;
  std::map<int, SourcePaths> paths = {};  ///< by order of harmonics; empty after a move
};

/// A listener of the caller, in metres of the world.
struct PlacedListener {
  ListenerLayout layout;
  glm::dvec3 position{0};
  glm::dquat orientation{1, 0, 0, 0};                     ///< own axes to world; unit
  std::shared_ptr<const Hrtf> hrtf = nullptr;             ///< null: the rigid sphere
  std::shared_ptr<RirSynthesizer> synthesizer = nullptr;  ///< null until it is needed
  float rir_length_s = 0;                                 ///< of the synthesizer: of its settings the one that the scene decides
};

/// What a listener hears from a source.
struct PairResponse {
  Rir rir;  ///< times the gain
  RoomMetrics metrics;
  double ray_efficiency = 0;
  std::string rir_arguments;
  bool is_silent = false;
  std::uint64_t num_not_finite = 0;
};

/// Computes responses as `earshot rir` does, and keeps what the next ones of the same scene need.
class PairRenderer {
 public:
  /// num_listeners: how many hear the source in this scene.
  PairResponse render(const std::shared_ptr<const AcousticScene>& acoustics, const ContextSettings& settings, PlacedSource& source,
                      PlacedListener& listener, std::pair<std::size_t, std::size_t> listener_and_source, std::size_t num_listeners);
  /// Trajectories begin anew.
  void clear_trajectories() { trajectories_.clear(); }

 private:
  std::map<std::pair<std::size_t, std::size_t>, TemporalReuse> trajectories_;
  EnergyResponse response_;
};

/// Of a listener whose own axes have this orientation: level where it only turns about the vertical.
ListenerOrientation listener_orientation(const PlacedListener& listener, const ContextSettings& settings);

}  // namespace earshot::compat
