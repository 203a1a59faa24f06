// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <complex>
#include <cstdint>
#include <memory>
#include <span>
#include <vector>

#include "sim/acoustics/core/acoustic_config.h"
#include "sim/acoustics/core/bands.h"
#include "sim/acoustics/geometry/diffraction_edges.h"
#include "sim/acoustics/geometry/folded_planes.h"
#include "sim/acoustics/geometry/mirror_planes.h"
#include "sim/acoustics/geometry/panel_edges.h"
#include "sim/acoustics/model/panel_shapes.h"
#include "sim/scene/scene.h"

namespace earshot {

class SpecularLobe;

/// A material that damps sound by this much or more in one band fills the bodies that it bounds.
inline constexpr float kSolidDampingDbPerM = 1.f;

/// Results of the geometry search, which takes most of the time of this class.
struct FoundGeometry {
  std::vector<DiffractionEdge> edges;  ///< with diffraction off: none
  MirrorPlanes planes;
  FoldedPlanes folds;
  std::vector<double> mean_absorption;  ///< [num_bands]
  std::vector<std::uint8_t> solid;      ///< by triangle (bounds_solid); empty: no material damps
};

/// Properties of a scene and a configuration that do not depend on the effect plan (effect_plan.h): coefficients per band, planes, edges.
/// Immutable,
/// shared by all threads; holds the scene alive.
class AcousticSurfaces {
 public:
  /// Throws InputError if `config` breaks a rule (validate), or has lobes where a material reacts locally.
  AcousticSurfaces(std::shared_ptr<const Scene> scene, const AcousticConfig& config);
  /// The same with what found() of other surfaces of this scene and configuration gave.
  AcousticSurfaces(std::shared_ptr<const Scene> scene, const AcousticConfig& config, FoundGeometry known);
  [[nodiscard]] FoundGeometry found() const;  ///< a copy

  [[nodiscard]] const Scene& scene() const { return *scene_; }
  [[nodiscard]] const std::shared_ptr<const Scene>& shared_scene() const { return scene_; }
  /// As the user gave it.
  [[nodiscard]] const AcousticConfig& config() const { return config_; }
  [[nodiscard]] const BandLayout& bands() const { return bands_; }
  [[nodiscard]] int num_bands() const { return bands_.size(); }
  /// Per material slot and band: [num_bands] each.  Means of the material's curves over each band.
  [[nodiscard]] std::span<const float> reflectance(std::uint32_t material) const {
    return row(reflectance_, material);
  }  ///< 1 - absorption
  [[nodiscard]] std::span<const float> scattering(std::uint32_t material) const { return row(scattering_, material); }
  [[nodiscard]] std::span<const float> transmission(std::uint32_t material) const { return row(transmission_, material); }
  [[nodiscard]] std::span<const float> damping_db_per_m(std::uint32_t material) const { return row(damping_, material); }  ///< inside it
  /// Whether a triangle bounds a body that its material fills (solid_bodies.h): the material damps by kSolidDampingDbPerM in a band.
  [[nodiscard]] bool bounds_solid(std::uint32_t triangle) const { return !solid_.empty() && solid_[triangle] != 0; }
  /// Locally reacting surfaces (wall_impedance.h), whose specular reflections depend on the angle; their diffuse ones do not, so that paths
  /// are the same from either end.
  [[nodiscard]] bool reacts_locally(std::uint32_t material) const {
    return !impedance_.empty() && impedance_[material * num_bands()].real() > 0;
  }
  [[nodiscard]] bool any_reacts_locally() const { return !impedance_.empty(); }
  /// Specular pressure reflection of such a material, scattering left out: at random incidence its square has the mean reflectance().
  [[nodiscard]] std::complex<double> mirror_pressure(std::uint32_t material, int band, double cosine) const;
  /// Multiplies energy [num_bands] by the specular energy reflection of such a material over reflectance().
  void scale_by_angle(std::uint32_t material, double cosine, std::span<float> energy) const;
  /// Does any material of the scene let energy through in any band?
  [[nodiscard]] bool transmits() const { return transmits_; }
  /// Bands rounded up to a multiple of eight: the rows below are that long and end in zeros, so that hot loops have no remainder.
  [[nodiscard]] int padded_bands() const { return stride_; }
  [[nodiscard]] const float* padded_reflectance(std::uint32_t material) const { return &reflectance_[std::size_t{material} * stride_]; }
  [[nodiscard]] const float* padded_scattering(std::uint32_t material) const { return &scattering_[std::size_t{material} * stride_]; }
  /// Lobes of specular reflections: none for mirrors (config.specular_exponent = 0), one, or the ladder of lobe_shares.h, where a lobe that
  /// no material uses is null.
  [[nodiscard]] std::span<const std::shared_ptr<const SpecularLobe>> specular_lobes() const { return specular_lobes_; }
  /// Largest energy fraction of any specular reflection in any band: (1 - absorption)(1 - scattering).
  [[nodiscard]] float largest_specular_reflectance() const;
  /// Of all triangles, by area: [num_bands]; 0 in an empty scene.
  [[nodiscard]] std::span<const double> mean_absorption() const { return mean_absorption_; }
  /// Edges that diffract sound; null with diffraction off.
  [[nodiscard]] const DiffractionEdges* diffraction_edges() const { return diffraction_edges_.get(); }
  /// Where mirror planes end in the air; null with diffraction off.
  [[nodiscard]] const PanelEdges* panel_edges() const { return panel_edges_.get(); }
  /// Those that bound panels in the air; null with diffraction off.
  [[nodiscard]] const PanelShapes* panel_shapes() const { return panel_shapes_.get(); }
  [[nodiscard]] std::span<const MirrorPlane> planes() const { return planes_.planes; }
  [[nodiscard]] std::span<const std::uint32_t> plane_of_triangle() const { return planes_.plane_of_triangle; }
  /// Surfaces of several planes that reflect long waves as one: up to an eighth of the longest wave deep.
  [[nodiscard]] const FoldedPlanes& folds() const { return folds_; }
  /// The same as panel_edges(), by folds; null without any.
  [[nodiscard]] const PanelEdges* fold_edges() const { return fold_edges_.get(); }
  [[nodiscard]] float speed_of_sound_m_per_s() const { return scene_->speed_of_sound_m_per_s(); }
  /// Diagonal of the bounds; zero for an empty scene.
  [[nodiscard]] float diagonal_m() const { return diagonal_m_; }
  [[nodiscard]] std::size_t bytes() const;  ///< of memory, without the scene

 private:
  [[nodiscard]] std::span<const float> row(const std::vector<float>& table, std::uint32_t material) const {
    return {&table[std::size_t{material} * stride_], static_cast<std::size_t>(num_bands())};
  }
  void set_coefficients();
  void make_lobes();
  void set_impedances();
  void average_absorption();
  void find_solids();
  void join_edges_to_planes();

  std::shared_ptr<const Scene> scene_;
  AcousticConfig config_;
  BandLayout bands_;
  int stride_ = 0;
  float diagonal_m_ = 0;
  std::vector<float> reflectance_, scattering_, transmission_, damping_;
  /// [materials][num_bands], real part 0: reflects alike at all angles; empty: all do.  kept_: energy reflection at random incidence over
  /// that of the impedance, below 1 where the absorption is more than any impedance has.
  std::vector<std::complex<double>> impedance_;
  std::vector<double> kept_;
  std::vector<double> mean_absorption_;
  std::vector<std::uint8_t> solid_;  ///< by triangle; empty: none
  bool transmits_ = false;
  std::vector<std::shared_ptr<const SpecularLobe>> specular_lobes_;
  std::shared_ptr<const DiffractionEdges> diffraction_edges_;
  MirrorPlanes planes_;
  FoldedPlanes folds_;
  std::shared_ptr<const PanelEdges> panel_edges_, fold_edges_;
  std::shared_ptr<const PanelShapes> panel_shapes_;
};

}  // namespace earshot
