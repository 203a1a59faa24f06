// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <memory>
#include <mutex>
#include <optional>
#include <span>
#include <stop_token>
#include <string>
#include <vector>

#include "api/scene_model.h"
#include "earshot/source.h"
#include "sim/acoustics/response/energy_response.h"
#include "sim/acoustics/response/place_check.h"
#include "sim/acoustics/source_field/source_field.h"
#include "sim/base/kept_results.h"

namespace earshot::api {

/// Data shared by the responses of one call: candidates of paths and, if the call uses one, the late field, for one order of harmonics.
struct SourceParts {
  std::shared_ptr<const AcousticScene> acoustics;
  std::shared_ptr<const EarlyCandidates> candidates;
  std::shared_ptr<const SourceField> field;
};

/// A source that stands still.  Safe from any thread.
struct Source::Model {
  Model(std::shared_ptr<Scene::Model> scene, const Vec3& position, const SourceOptions& options);

  [[nodiscard]] const std::shared_ptr<Scene::Model>& scene() const { return scene_; }
  [[nodiscard]] const SoundSource& source() const { return source_; }
  /// With a source field where the plan of the scene calls for one for so many responses in a call, and without where it does not: calls
  /// before decide what is made anew, never what is used.  Throws RunError once `stop` is requested.
  SourceParts parts(int sh_order, std::size_t responses, const std::stop_token& stop);
  /// Warns of places, or throws InputError for one outside the closed scene (place_check.h).
  void check_places(std::shared_ptr<const AcousticScene> acoustics, std::span<const Vec3> listeners);

 private:
  std::shared_ptr<Scene::Model> scene_;
  SoundSource source_;
  KeptResults<int, EarlyCandidates> candidates_;  ///< by order of harmonics, as the fields
  KeptResults<int, SourceField> fields_;
  std::mutex mutex_;  ///< guards what is below, for a moment
  std::shared_ptr<const AcousticScene> checked_;
  std::optional<PlaceCheck> places_;  ///< of checked_, from the first call on
};

/// One response before any head, with its origin.
struct Response::Model {
  std::shared_ptr<Scene::Model> scene;
  SourceParts parts;
  glm::vec3 listener{0};
  std::string channels;
  EnergyResponse response;
  std::vector<Arrival> arrivals;          ///< of `response`, in public terms
  std::vector<float> amplitudes, phases;  ///< [arrivals, bands], to which they refer
};

/// Fills `arrivals` from `response`.
void describe_arrivals(Response::Model& model);

/// @throws InputError for an angle that is not finite.
ListenerOrientation orientation_of(double heading_deg, double pitch_deg, double roll_deg);

/// The response of a listener as pressure.
Rir synthesize(RirSynthesizer& synthesizer, const SourceParts& parts, const ListenerOrientation& orientation, glm::vec3 listener,
               const EnergyResponse& response);

}  // namespace earshot::api
