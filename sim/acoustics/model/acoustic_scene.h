#pragma once

#include <cstdint>
#include <memory>
#include <span>
#include <vector>

#include "sim/acoustics/core/acoustic_config.h"
#include "sim/acoustics/core/bands.h"
#include "sim/acoustics/geometry/mirror_planes.h"
#include "sim/scene/scene.h"

namespace earshot {

class DiffractionEdges;
struct EffectPlan;
class FieldGrid;
class FieldSmoothing;
class ReflectionModel;
class SpecularLobe;

/// A scene seen through one acoustic configuration: coefficients per band, air, planes, and the plan of what to simulate in it.  Immutable,
/// shared by all threads; holds the scene alive.
class AcousticScene {
 public:
  /// Throws InputError if `config` breaks a rule (validate).
  AcousticScene(std::shared_ptr<const Scene> scene, const AcousticConfig& config);
  /// The same with another number of rays and another seed, as a copy: nothing is derived from the geometry again.
  [[nodiscard]] AcousticScene with_rays(int rays, std::uint64_t seed) const;

  [[nodiscard]] const Scene& scene() const { return *scene_; }
  [[nodiscard]] const std::shared_ptr<const Scene>& shared_scene() const { return scene_; }
  /// As given, with what was left to the plan filled in: rir_length_s is never 0 here, and late is off where nothing comes back.
  [[nodiscard]] const AcousticConfig& config() const { return config_; }
  /// Which effects are simulated, with the bound that each decision rests on (effect_plan.h).
  [[nodiscard]] const EffectPlan& plan() const { return *plan_; }
  [[nodiscard]] const BandLayout& bands() const { return bands_; }
  [[nodiscard]] int num_bands() const { return bands_.size(); }
  /// Per material slot and band: [num_bands] each.  Means of the material's curves over each band.
  [[nodiscard]] std::span<const float> reflectance(std::uint32_t material) const {
    return row(reflectance_, material);
  }  ///< 1 - absorption
  [[nodiscard]] std::span<const float> scattering(std::uint32_t material) const { return row(scattering_, material); }
  [[nodiscard]] std::span<const float> transmission(std::uint32_t material) const { return row(transmission_, material); }
  [[nodiscard]] std::span<const float> damping_db_per_m(std::uint32_t material) const { return row(damping_, material); }  ///< inside it
  /// Does any material of the scene let energy through in any band?
  [[nodiscard]] bool transmits() const { return transmits_; }
  /// Bands rounded up to a multiple of eight: the rows below are that long and end in zeros, so that hot loops have no remainder.
  [[nodiscard]] int padded_bands() const { return stride_; }
  [[nodiscard]] const float* padded_reflectance(std::uint32_t material) const { return &reflectance_[std::size_t{material} * stride_]; }
  [[nodiscard]] const float* padded_scattering(std::uint32_t material) const { return &scattering_[std::size_t{material} * stride_]; }
  /// Lobe of the specular share; null for a mirror (config.specular_exponent = 0).
  [[nodiscard]] const SpecularLobe* specular_lobe() const { return specular_lobe_.get(); }
  /// Up to which order image paths carry specular reflections: 0 without mirrors.
  [[nodiscard]] int image_order() const { return image_order_; }
  /// What surfaces keep, scatter and let through, for the tracers; with transmission if traces_transmission(*this).
  [[nodiscard]] const ReflectionModel& reflection_model() const { return *reflection_model_; }
  /// Edges round which sound bends; null with diffraction off.
  [[nodiscard]] const DiffractionEdges* diffraction_edges() const { return diffraction_edges_.get(); }
  /// Cells of the source fields, found on the first call, once, from any thread.
  [[nodiscard]] const FieldGrid& field_grid() const;
  /// How late energy evens out between those cells; found with them.
  [[nodiscard]] const FieldSmoothing& field_smoothing() const;
  /// Energy exponent of air per band, at its centre; zero where air absorption is off.
  [[nodiscard]] std::span<const float> air_energy_per_m() const { return air_; }
  [[nodiscard]] std::span<const MirrorPlane> planes() const { return planes_.planes; }
  [[nodiscard]] std::span<const std::uint32_t> plane_of_triangle() const { return planes_.plane_of_triangle; }
  [[nodiscard]] float speed_of_sound_m_per_s() const { return scene_->speed_of_sound_m_per_s(); }
  /// Longest path that still arrives within the configured RIR length.
  [[nodiscard]] float max_path_m() const { return config_.rir_length_s * speed_of_sound_m_per_s(); }
  /// Diagonal of the bounds; zero for an empty scene.
  [[nodiscard]] float diagonal_m() const { return diagonal_m_; }
  /// Identity of everything that decides bits: scene hash and config, without the thread count.
  [[nodiscard]] std::uint64_t hash() const { return hash_; }

 private:
  [[nodiscard]] std::span<const float> row(const std::vector<float>& table, std::uint32_t material) const {
    return {&table[std::size_t{material} * stride_], static_cast<std::size_t>(num_bands())};
  }

  std::shared_ptr<const Scene> scene_;
  AcousticConfig config_;
  BandLayout bands_;
  int stride_ = 0;
  float diagonal_m_ = 0;
  int image_order_ = 0;
  std::vector<float> reflectance_, scattering_, transmission_, damping_, air_;
  bool transmits_ = false;
  std::shared_ptr<const SpecularLobe> specular_lobe_;
  std::shared_ptr<const EffectPlan> plan_;
  std::shared_ptr<const ReflectionModel> reflection_model_;
  std::shared_ptr<const DiffractionEdges> diffraction_edges_;
  struct LazyGrid;
  std::shared_ptr<LazyGrid> field_grid_;  ///< shared by copies
  MirrorPlanes planes_;
  std::uint64_t hash_ = 0;
};

}  // namespace earshot
