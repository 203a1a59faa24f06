#pragma once

#include <cstdint>
#include <glm/vec3.hpp>
#include <map>
#include <memory>
#include <mutex>
#include <optional>
#include <span>
#include <string>
#include <utility>
#include <vector>

#include "sim/acoustics/accuracy/accuracy_plan.h"
#include "sim/acoustics/response/energy_response.h"
#include "sim/acoustics/response/place_check.h"
#include "sim/acoustics/source_field/source_field.h"
#include "sim/acoustics/synthesis/rir_synthesis.h"

namespace earshot::python {

/// A scene with acoustic settings.  What depends on a listener's channels (the order of harmonics, synthesis tables) is made when it is
/// first needed and kept.  Safe from any thread.
class SceneModel {
 public:
  /// settings: key=value over the preset, as `earshot rir --set`.  Throws InputError.
  SceneModel(const std::string& spec, const std::string& preset, const std::vector<std::string>& settings, std::optional<double> rate_hz,
             std::optional<std::uint64_t> seed, const SceneOverrides& overrides);

  [[nodiscard]] const Scene& scene() const { return *scene_; }
  [[nodiscard]] const AcousticConfig& config() const { return config_; }
  /// What may not be meant: of the scene (scene_check.h), and of the places since then (place_check.h), each line once.
  [[nodiscard]] std::vector<std::string> warnings() const;
  void add_warnings(const std::vector<std::string>& lines);
  /// Order of the harmonics that these channels need of the late field: as `earshot rir` chooses it.
  [[nodiscard]] int harmonics_of(const ListenerLayout& layout) const;
  std::shared_ptr<const AcousticScene> acoustics(int sh_order);
  /// Tables of the channels (ListenerLayout::named); hrtf: SOFA file, empty: a rigid sphere.
  std::shared_ptr<const SynthesisTables> tables(const std::string& channels, const std::string& hrtf);

 private:
  std::shared_ptr<const Scene> scene_;
  AcousticConfig config_;
  mutable std::mutex mutex_;
  std::vector<std::string> warnings_;
  std::map<int, std::shared_ptr<const AcousticScene>> acoustics_;
  std::map<std::pair<std::string, std::string>, std::shared_ptr<const SynthesisTables>> tables_;
};

/// Of a source: its candidates of paths and, if built, its late field, for each order of harmonics.
struct SourceParts {
  std::shared_ptr<const AcousticScene> acoustics;
  std::shared_ptr<const EarlyCandidates> candidates;
  std::shared_ptr<const SourceField> field;
};

/// One response before any head, with what it was computed from.
struct ResponseModel {
  std::shared_ptr<SceneModel> scene;
  SourceParts parts;
  glm::vec3 listener{0};
  EnergyResponse response;
};

/// Where a listener is and how it is turned, in world coordinates and degrees.
struct ListenerPose {
  glm::dvec3 position{0};
  double heading_deg = 0, pitch_deg = 0, roll_deg = 0;
  [[nodiscard]] ListenerOrientation orientation() const;
};

/// A source that stands still in a scene.  Safe from any thread.
class SourceModel {
 public:
  /// heading and pitch in degrees; pattern as Directivity::named.  Throws InputError.
  SourceModel(std::shared_ptr<SceneModel> scene, glm::dvec3 position, const std::string& pattern, double heading_deg, double pitch_deg,
              double radius_m);
  [[nodiscard]] const std::shared_ptr<SceneModel>& scene() const { return scene_; }
  [[nodiscard]] const SoundSource& source() const { return source_; }
  /// For `responses` poses a source field is built where the plan of the scene calls for one: many share its cost.
  SourceParts parts(int sh_order, std::size_t responses);
  /// Responses of all listeners on `threads` threads (0: all cores): the same bits for any number.  This and render throw InputError where
  /// the source or a listener lies outside the closed scene (place_check.h).
  std::vector<ResponseModel> respond(std::span<const ListenerPose> listeners, const std::string& channels, int threads);
  /// RIRs [listeners, channels, samples] of all listeners.
  std::vector<Rir> render(std::span<const ListenerPose> listeners, const std::string& channels, const std::string& hrtf, int threads);
  /// The cheapest settings within `target` (AccuracyTarget::parse) for so many responses at places like these.
  AccuracyPlan plan_accuracy(const std::string& target, std::span<const ListenerPose> listeners, double responses);

 private:
  void check_places(std::shared_ptr<const AcousticScene> acoustics, std::span<const ListenerPose> listeners);

  std::shared_ptr<SceneModel> scene_;
  SoundSource source_;
  std::mutex mutex_;
  std::map<int, SourceParts> parts_;
  std::shared_ptr<const AcousticScene> checked_;
  std::optional<PlaceCheck> places_;  ///< of checked_, from the first call on
};

/// The RIR of a response for a listener of this orientation.  Throws InputError for channels that need harmonics it was computed without.
Rir render(const ResponseModel& response, const ListenerPose& pose, const std::string& channels, const std::string& hrtf);

/// Free places in a scene for sources and listeners, `height_m` above the walkable floor: [count], world coordinates.  A function of
/// (scene, count's index, seed).  Throws InputError where too few places are free.
std::vector<glm::dvec3> random_positions(const Scene& scene, int count, double height_m, std::uint64_t seed);

}  // namespace earshot::python
