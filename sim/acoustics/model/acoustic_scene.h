// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <memory>
#include <span>
#include <vector>

#include "sim/acoustics/core/acoustic_config.h"
#include "sim/acoustics/core/air_loss.h"
#include "sim/acoustics/core/bands.h"
#include "sim/acoustics/model/acoustic_surfaces.h"
#include "sim/acoustics/model/effect_plan.h"
#include "sim/acoustics/model/wall_power.h"
#include "sim/scene/scene.h"

namespace earshot {

class FieldGrid;
class FieldSmoothing;
class PlaneCells;
class ReflectionModel;

/// A scene under one acoustic configuration, in three steps: its surfaces, the plan of what to simulate between them, and what follows from
/// both.  Immutable, shared by all threads; holds the scene alive.
class AcousticScene {
 public:
  /// Throws InputError if `config` breaks a rule (validate), or as plan_effects does.
  AcousticScene(std::shared_ptr<const Scene> scene, const AcousticConfig& config);
  /// The same with the plan that plan_effects(surfaces) gave.
  AcousticScene(AcousticSurfaces surfaces, EffectPlan plan);
  /// The same with another number of rays and another seed, as a copy: surfaces and plan stay those of the first config.
  [[nodiscard]] AcousticScene with_rays(int rays, std::uint64_t seed) const;

  [[nodiscard]] const AcousticSurfaces& surfaces() const { return surfaces_; }
  /// Which effects are simulated, with the bound that each decision rests on.
  [[nodiscard]] const EffectPlan& plan() const { return *plan_; }
  /// As given, with what was left to the plan filled in: rir_length_s and source_radius_m are never 0 here, and late is off where nothing
  /// comes back.
  [[nodiscard]] const AcousticConfig& config() const { return config_; }

  // of the surfaces (acoustic_surfaces.h)
  [[nodiscard]] const Scene& scene() const { return surfaces_.scene(); }
  [[nodiscard]] const std::shared_ptr<const Scene>& shared_scene() const { return surfaces_.shared_scene(); }
  [[nodiscard]] const BandLayout& bands() const { return surfaces_.bands(); }
  [[nodiscard]] int num_bands() const { return surfaces_.num_bands(); }
  [[nodiscard]] int padded_bands() const { return surfaces_.padded_bands(); }
  [[nodiscard]] std::span<const float> reflectance(std::uint32_t material) const { return surfaces_.reflectance(material); }
  [[nodiscard]] std::span<const float> scattering(std::uint32_t material) const { return surfaces_.scattering(material); }
  [[nodiscard]] std::span<const float> transmission(std::uint32_t material) const { return surfaces_.transmission(material); }
  [[nodiscard]] std::span<const float> damping_db_per_m(std::uint32_t material) const { return surfaces_.damping_db_per_m(material); }
  [[nodiscard]] const float* padded_reflectance(std::uint32_t material) const { return surfaces_.padded_reflectance(material); }
  [[nodiscard]] const float* padded_scattering(std::uint32_t material) const { return surfaces_.padded_scattering(material); }
  [[nodiscard]] bool transmits() const { return surfaces_.transmits(); }
  [[nodiscard]] const DiffractionEdges* diffraction_edges() const { return surfaces_.diffraction_edges(); }
  [[nodiscard]] const PanelEdges* panel_edges() const { return surfaces_.panel_edges(); }
  [[nodiscard]] const PanelShapes* panel_shapes() const { return surfaces_.panel_shapes(); }
  [[nodiscard]] const FoldedPlanes& folds() const { return surfaces_.folds(); }
  [[nodiscard]] const PanelEdges* fold_edges() const { return surfaces_.fold_edges(); }
  [[nodiscard]] std::span<const MirrorPlane> planes() const { return surfaces_.planes(); }
  [[nodiscard]] std::span<const std::uint32_t> plane_of_triangle() const { return surfaces_.plane_of_triangle(); }
  [[nodiscard]] float speed_of_sound_m_per_s() const { return surfaces_.speed_of_sound_m_per_s(); }
  [[nodiscard]] float diagonal_m() const { return surfaces_.diagonal_m(); }

  // of the plan
  /// Up to which order image paths carry specular reflections: 0 without mirrors.
  [[nodiscard]] int image_order() const { return plan_->image_order; }
  /// Longest path that still arrives within the configured RIR length.
  [[nodiscard]] float max_path_m() const { return config_.rir_length_s * speed_of_sound_m_per_s(); }
  /// Energy exponent of air per band, at its centre; zero where air absorption is off.
  [[nodiscard]] std::span<const float> air_energy_per_m() const {
    return std::span(air_.band_per_m).first(static_cast<std::size_t>(num_bands()));
  }
  /// The same with the loss over frequency.
  [[nodiscard]] const AirLoss& air_loss() const { return air_; }
  /// Reflected, scattered and transmitted fractions of the surfaces, for the tracers; with transmission if traces_transmission(*this).
  [[nodiscard]] const ReflectionModel& reflection_model() const { return *reflection_model_; }

  /// Factor of late energy of a source or a listener at `point`: that of walls near it (wall_power.h); all 1 where the plan leaves it out.
  [[nodiscard]] WallGain wall_gain(glm::vec3 point) const { return wall_power_ ? wall_power_->at(surfaces_, point) : WallGain(); }

  /// Cells of the source fields, found on the first call, once, from any thread.
  [[nodiscard]] const FieldGrid& field_grid() const;
  /// How late energy evens out between those cells; found with them.
  [[nodiscard]] const FieldSmoothing& field_smoothing() const;
  /// Plane sequences of sources that move, by cells of the air; shared by copies.
  [[nodiscard]] const PlaneCells& plane_cells() const { return *plane_cells_; }
  /// Identity of everything that decides bits: scene hash and config, without the thread count.
  [[nodiscard]] std::uint64_t hash() const { return hash_; }
  /// Of memory that it holds now, without the scene; grows with what is found on demand: cells of source fields, plane sequences.
  [[nodiscard]] std::size_t bytes() const;

 private:
  /// plan: null to make it here.
  AcousticScene(AcousticSurfaces surfaces, std::shared_ptr<const EffectPlan> plan);

  AcousticSurfaces surfaces_;
  std::shared_ptr<const EffectPlan> plan_;
  AcousticConfig config_;
  AirLoss air_;
  std::shared_ptr<const ReflectionModel> reflection_model_;
  std::shared_ptr<const WallPower> wall_power_;  ///< null: off
  struct LazyGrid;
  std::shared_ptr<LazyGrid> field_grid_;  ///< shared by copies
  std::shared_ptr<const PlaneCells> plane_cells_;
  std::uint64_t hash_ = 0;
};

/// Is transmission part of the late field here?  On request, and where the plan finds that walls matter beside the air.
inline bool traces_transmission(const AcousticScene& scene) { return scene.plan().traced_transmission; }

/// Whether the plan calls for a SourceField for the late part of a source that stands still: where it reaches the same error as tracing
/// with less work over kPosesPerSource poses (source_poses.h).
inline bool uses_source_field(const AcousticScene& scene) { return scene.plan().field; }

}  // namespace earshot
