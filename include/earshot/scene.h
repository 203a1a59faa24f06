// SPDX-License-Identifier: Apache-2.0
#pragma once

/// @file
/// Scenes with acoustic settings: begin here.

#include <array>
#include <cstddef>
#include <cstdint>
#include <memory>
#include <optional>
#include <stop_token>
#include <string>
#include <vector>

#include "earshot/config.h"
#include "earshot/source.h"
#include "earshot/vec3.h"

namespace earshot::api {

/// Acoustics and units of a scene.
struct SceneOptions {
  std::string preset = "balanced";                   ///< fast, balanced or high
  Settings settings = {};                            ///< over the preset, as `earshot rir --set`
  std::optional<double> rate_hz = std::nullopt;      ///< [8000, 96000]; default: the preset's
  std::optional<std::uint64_t> seed = std::nullopt;  ///< of rays and carriers; default 0
  std::optional<double> unit_m = std::nullopt;       ///< metres per unit of a mesh file; default: what a scene YAML says, else 1
  std::optional<double> simplify_m = std::nullopt;   ///< a mesh is simplified within this distance
  std::string up = {};                               ///< axis of a mesh file that points up, y or z; empty: what a scene YAML says, else y
  std::optional<double> cell_m = std::nullopt;       ///< edge of the voxels of a point cloud; default: the scene YAML, else its points
};

/// One line of the effect plan: whether an effect is simulated in a scene, and the bound that the decision rests on.
struct EffectDecision {
  std::string effect, decision;
  bool on = false;
  double change = 0;  ///< off: largest change of a response if it were on; NaN: no such number
  std::string unit;   ///< of `change`
  std::string kind;   ///< exact, bounded, approximated or user_set
  double saved_ms = 0;
  std::string why;
};

/// Options of Scene::random_positions.
struct PlaceOptions {
  double height_m = 1.5;  ///< above the floor, (0, 10]
  std::uint64_t seed = 0;
  std::stop_token stop = {};  ///< a request to stop ends the call with a RunError, at the next place
};

/// A scene with acoustic settings.
///
/// \code
/// #include <earshot/scene.h>
///
/// earshot::Scene scene("house:7");
/// const auto places = scene.random_positions(2, {.seed = 1});
/// earshot::Rir rir = scene.source(places[0]).render(places[1]);
/// \endcode
///
/// Copies share the scene.  Results are those of the Python package and of `earshot rir`, bit for bit where all are built with the same
/// audio libraries.
///
/// Threads: any number of callers.
/// Cost:    a mesh of 100,000 triangles loads in about a second; the effect plan takes milliseconds, at the first call that needs it.
class Scene {
 public:
  /// @param spec  a mesh file (glb, gltf, obj, ply, stl), a point cloud (ply, pcd, xyz, las), `shoebox:XxYxZ[@ABSORPTION]`,
  ///              `house:SEED[,key=value]`, `floor:SEED`, or a scene YAML.
  /// @param options  acoustics, and the units of a mesh file.
  /// @throws InputError for a scene that cannot be read, an unknown preset or setting, or a value out of range.
  explicit Scene(const std::string& spec, const SceneOptions& options = {});

  [[nodiscard]] const std::string& name() const;  ///< the spec, with the unit and axis that were given
  [[nodiscard]] std::uint64_t hash() const;       ///< of geometry, materials and air
  [[nodiscard]] std::size_t num_triangles() const;
  [[nodiscard]] Bounds bounds() const;
  [[nodiscard]] double sample_rate_hz() const;
  [[nodiscard]] std::uint64_t seed() const;
  [[nodiscard]] double rir_length_s() const;               ///< of every response; found from the decay with rir_length_s=auto
  [[nodiscard]] std::vector<double> bands_hz() const;      ///< centres, low to high
  [[nodiscard]] std::vector<EffectDecision> plan() const;  ///< which effects are simulated, and why
  /// Likely mistakes in the scene (holes, units, axes), and in places since then; each line once.
  [[nodiscard]] std::vector<std::string> warnings() const;

  /// Free places above the walkable floor.  The first n do not depend on the count.
  /// @param count    [0, 1,000,000].
  /// @param options  height above the floor, and seed.
  /// @throws InputError if nothing is walkable, or too few places are free.
  [[nodiscard]] std::vector<Vec3> random_positions(int count, const PlaceOptions& options = {}) const;

  /// Where the surfaces cross a level plane, as a floor plan shows walls: [segments, 2 ends].  Surfaces in the plane have no segment.
  /// @param height_m  y of the plane.
  /// @throws InputError if it is not finite.
  [[nodiscard]] std::vector<std::array<Vec3, 2>> section(double height_m) const;

  /// A source that stands still.
  /// @throws InputError for a position that is not finite, an unknown pattern, or a radius out of range.
  [[nodiscard]] Source source(const Vec3& position, const SourceOptions& options = {}) const;

  struct Model;
  [[nodiscard]] const std::shared_ptr<Model>& model() const { return model_; }  ///< for the library

 private:
  std::shared_ptr<Model> model_;
};

}  // namespace earshot::api
