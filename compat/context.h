// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstddef>
#include <filesystem>
#include <glm/gtc/quaternion.hpp>
#include <glm/vec3.hpp>
#include <map>
#include <memory>
#include <optional>
#include <set>
#include <string>
#include <vector>

#include "compat/context_settings.h"
#include "compat/object_mesh.h"
#include "compat/pair_renderer.h"
#include "compat/rlr_audio_propagation.h"
#include "compat/scene_objects.h"
#include "sim/acoustics/model/acoustic_scene.h"

namespace earshot::compat {

/// Sources, listeners, objects and responses behind one handle of the C interface.  Functions throw CallError, InputError or RunError and
/// then change nothing, unless they say so.  One thread at a time.
class Context {
 public:
  explicit Context(const RLRA_ContextConfiguration& configuration);
  void reset(const RLRA_ContextConfiguration& configuration);

  void add_source() { sources_.emplace_back(); }
  void clear_sources();
  [[nodiscard]] std::size_t num_sources() const { return sources_.size(); }
  void set_source_position(std::size_t source, glm::dvec3 units);
  void set_source_radius(std::size_t source, double units);

  void add_listener(const RLRA_ChannelLayout& layout);
  void clear_listeners();
  [[nodiscard]] std::size_t num_listeners() const { return listeners_.size(); }
  void set_listener_position(std::size_t listener, glm::dvec3 units);
  void set_listener_orientation(std::size_t listener, glm::dquat orientation);
  void set_listener_radius(std::size_t listener, double units);
  /// sofa: empty for the rigid sphere.
  void set_listener_hrtf(std::size_t listener, const std::string& sofa);

  void add_object();
  void clear_objects();
  [[nodiscard]] std::size_t num_objects() const { return objects_.size(); }
  void set_object_position(std::size_t object, glm::dvec3 units);
  void set_object_orientation(std::size_t object, glm::dquat orientation);
  void set_object_mesh(std::size_t object, ObjectMesh mesh);
  [[nodiscard]] MeshStaging& staging() { return staging_; }
  /// The staged mesh begins anew in any case.
  void finalize_object_mesh(std::size_t object);
  void set_material_database(const std::filesystem::path& path);
  [[nodiscard]] std::string obj_text();

  /// Leaves no responses where it throws.
  void simulate();
  [[nodiscard]] std::size_t num_responses() const { return responses_.size(); }
  /// Null for a pair that was not simulated.
  [[nodiscard]] const PairResponse* response(std::size_t listener, std::size_t source) const;
  [[nodiscard]] std::string metrics_text(std::size_t listener, std::size_t source) const;
  [[nodiscard]] double ray_efficiency() const;
  void trace(RLRA_Ray& ray);

  /// Writes a line to stderr, each line once and kMaxLines in all.
  void warn_once(const std::string& line);

 private:
  static constexpr std::size_t kMaxLines = 64;
  Context(ContextSettings settings, std::set<std::string> lines);

  [[nodiscard]] glm::dvec3 place_of(glm::dvec3 units) const;
  SceneObject& object(std::size_t index);
  void invalidate_scene();
  /// Null without any surface.
  const std::shared_ptr<const Scene>& scene();
  /// With this order of harmonics.
  std::shared_ptr<const AcousticScene> acoustics(int sh_order);
  [[nodiscard]] AcousticScene plan(std::shared_ptr<const Scene> scene, AcousticConfig config) const;

  ContextSettings settings_;
  std::vector<PlacedSource> sources_;
  std::vector<PlacedListener> listeners_;
  std::vector<SceneObject> objects_;
  MeshStaging staging_;
  std::optional<MaterialDatabase> database_;

  bool is_scene_known_ = false;
  std::shared_ptr<const Scene> scene_;
  std::map<int, std::shared_ptr<const AcousticScene>> acoustics_;  ///< by order of harmonics
  PairRenderer renderer_;

  std::size_t num_simulated_sources_ = 0;
  std::vector<PairResponse> responses_;  ///< [listeners, sources]
  std::set<std::string> lines_;
};

}  // namespace earshot::compat
