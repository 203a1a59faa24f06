// SPDX-License-Identifier: Apache-2.0
#include "sim/acoustics/model/acoustic_surfaces.h"

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <glm/geometric.hpp>
#include <mutex>
#include <utility>

#include "sim/acoustics/model/lobe_shares.h"
#include "sim/acoustics/model/solid_bodies.h"
#include "sim/acoustics/model/specular_lobe.h"
#include "sim/base/denormals.h"
#include "sim/base/errors.h"
#include "sim/base/memory_bytes.h"
#include "sim/scene/materials/wall_impedance.h"

namespace earshot {
namespace {

/// A lobe of the ladder: a constant of 50 ms, made at its first use and shared by all surfaces of the process.  Safe from any thread.
std::shared_ptr<const SpecularLobe> lobe_of_ladder(std::size_t i) {
  static std::array<std::once_flag, kLobeLadder> made;
  static std::array<std::shared_ptr<const SpecularLobe>, kLobeLadder> lobes;
  std::call_once(made[i], [&] { lobes[i] = std::make_shared<const SpecularLobe>(kLadderExponents[i]); });
  return lobes[i];
}

}  // namespace

AcousticSurfaces::AcousticSurfaces(std::shared_ptr<const Scene> scene, const AcousticConfig& config)
    : scene_(std::move(scene)), config_(config) {
  const FlushDenormals flush;
  set_coefficients();
  average_absorption();
  find_solids();
  if (config_.diffraction != Switch::off)
    diffraction_edges_ = std::make_shared<const DiffractionEdges>(*scene_, config_.diffraction_edge_m);
  planes_ = find_mirror_planes(scene_->mesh());
  folds_ = find_folded_planes(scene_->mesh(), planes_, speed_of_sound_m_per_s() / bands_.centre_hz.front() / 8.0);
  join_edges_to_planes();
}

AcousticSurfaces::AcousticSurfaces(std::shared_ptr<const Scene> scene, const AcousticConfig& config, FoundGeometry known)
    : scene_(std::move(scene)), config_(config) {
  const FlushDenormals flush;
  set_coefficients();
  mean_absorption_ = std::move(known.mean_absorption);
  solid_ = std::move(known.solid);
  if (config_.diffraction != Switch::off) diffraction_edges_ = std::make_shared<const DiffractionEdges>(*scene_, std::move(known.edges));
  planes_ = std::move(known.planes);
  folds_ = std::move(known.folds);
  join_edges_to_planes();
}

FoundGeometry AcousticSurfaces::found() const {
  FoundGeometry found{.edges = {}, .planes = planes_, .folds = folds_, .mean_absorption = mean_absorption_, .solid = solid_};
  if (diffraction_edges_) found.edges.assign(diffraction_edges_->edges().begin(), diffraction_edges_->edges().end());
  return found;
}

void AcousticSurfaces::set_coefficients() {
  validate(config_);
  bands_ = bands_of(config_);
  stride_ = (num_bands() + 7) / 8 * 8;

  const std::vector<Material>& materials = scene_->materials();
  const std::size_t size = materials.size() * static_cast<std::size_t>(stride_);
  reflectance_.assign(size, 0.f);
  scattering_.assign(size, 0.f);
  transmission_.assign(size, 0.f);
  damping_.assign(size, 0.f);
  for (std::size_t slot = 0; slot < materials.size(); ++slot) {
    const Material& material = materials[slot];
    for (int band = 0; band < num_bands(); ++band) {
      const float low_hz = bands_.edge_hz[band], high_hz = bands_.edge_hz[band + 1];
      const auto mean = [&](const CoefficientCurve& curve) { return std::clamp(curve.band_mean(low_hz, high_hz), 0.f, 1.f); };
      const std::size_t cell = slot * stride_ + band;
      reflectance_[cell] = 1.f - mean(material.absorption);
      scattering_[cell] = config_.scattering >= 0.f ? config_.scattering : mean(material.scattering);
      // Transmitted energy is part of the energy that is not reflected (docs/evidence/oracles.md, O-22; docs/evidence/stability.md, H-27).
      transmission_[cell] = std::min(mean(material.transmission), 1.f - reflectance_[cell]);
      transmits_ = transmits_ || transmission_[cell] > 0.f;
      damping_[cell] = std::max(material.damping_db_per_m.band_mean(low_hz, high_hz), 0.f);
    }
  }
  set_impedances();
  make_lobes();
  if (!scene_->mesh().triangles.empty()) diagonal_m_ = glm::length(scene_->bounds().upper - scene_->bounds().lower);
}

void AcousticSurfaces::make_lobes() {
  if (config_.specular_exponent > 0.f)
    specular_lobes_ = {std::make_shared<const SpecularLobe>(config_.specular_exponent)};
  else if (config_.specular_exponent == kExponentFromScattering)
    specular_lobes_.resize(kLobeLadder);
  if (specular_lobes_.size() != kLobeLadder) return;
  for (std::uint32_t slot = 0; slot < scene_->materials().size(); ++slot)
    for (const float s : scattering(slot)) {
      const LobeShares shares = shares_of_scattering(s);
      for (std::size_t i = 0; i < kLobeLadder; ++i)
        if (shares.lobe[i] > 0.f && !specular_lobes_[i]) specular_lobes_[i] = lobe_of_ladder(i);
    }
}

void AcousticSurfaces::set_impedances() {
  const std::vector<Material>& materials = scene_->materials();
  const auto reacting = std::ranges::find_if(materials, &Material::locally_reacting);
  if (reacting == materials.end()) return;
  if (config_.specular_exponent != 0.f)
    throw InputError("specular_exponent",
                     fmt::format("its lobes know no angle of incidence, but material '{}' has angle: locally_reacting", reacting->name),
                     "set specular_exponent=0, or angle: random");
  const auto bands = static_cast<std::size_t>(num_bands());
  impedance_.assign(materials.size() * bands, 0.0);
  kept_.assign(materials.size() * bands, 1.0);
  for (std::size_t slot = 0; slot < materials.size(); ++slot) {
    const Material& material = materials[slot];
    if (!material.locally_reacting) continue;
    for (std::size_t band = 0; band < bands; ++band) {
      const std::size_t cell = slot * bands + band;
      float& reflectance = reflectance_[slot * static_cast<std::size_t>(stride_) + band];
      if (material.impedance_real.hz.empty()) {
        const double absorption = 1.0 - double{reflectance};
        impedance_[cell] = impedance_of_absorption(absorption);
        kept_[cell] = (1.0 - absorption) / (1.0 - random_incidence_absorption(impedance_[cell]));
      } else {
        const float hz = bands_.centre_hz[band];
        impedance_[cell] = {double{material.impedance_real.at(hz)}, double{material.impedance_imaginary.at(hz)}};
        reflectance = static_cast<float>(1.0 - random_incidence_absorption(impedance_[cell]));
      }
    }
  }
}

std::complex<double> AcousticSurfaces::mirror_pressure(std::uint32_t material, int band, double cosine) const {
  const std::size_t cell = std::size_t{material} * static_cast<std::size_t>(num_bands()) + static_cast<std::size_t>(band);
  return std::sqrt(kept_[cell]) * wall_reflection(impedance_[cell], cosine);
}

void AcousticSurfaces::scale_by_angle(std::uint32_t material, double cosine, std::span<float> energy) const {
  const auto mean = reflectance(material);
  for (std::size_t band = 0; band < mean.size(); ++band) {
    if (!(mean[band] > 0.f)) continue;
    energy[band] *= static_cast<float>(std::norm(mirror_pressure(material, static_cast<int>(band), cosine)) / double{mean[band]});
  }
}

void AcousticSurfaces::find_solids() {
  const TriangleMesh& mesh = scene_->mesh();
  std::vector<std::uint8_t> damps(scene_->materials().size());
  for (std::uint32_t slot = 0; slot < damps.size(); ++slot)
    damps[slot] = std::ranges::any_of(transmission(slot), [](float tau) { return tau > 0; }) &&
                  std::ranges::any_of(damping_db_per_m(slot), [](float damping) { return damping >= kSolidDampingDbPerM; });
  if (std::ranges::find(damps, 1) == damps.end()) return;
  solid_ = bounds_of_bodies(mesh);
  for (std::size_t t = 0; t < solid_.size(); ++t) solid_[t] = solid_[t] && damps[mesh.triangle_material[t]];
}

void AcousticSurfaces::join_edges_to_planes() {
  if (diffraction_edges_ == nullptr) return;
  panel_edges_ = std::make_shared<const PanelEdges>(*scene_, *diffraction_edges_, planes_.plane_of_triangle, planes_.planes.size());
  panel_shapes_ = std::make_shared<const PanelShapes>(*scene_, *panel_edges_, planes_.plane_of_triangle, planes_.planes.size(),
                                                      diffraction_edges_->size(), config_.diffraction_reflections == 0);
  if (!folds_.planes.empty())
    fold_edges_ = std::make_shared<const PanelEdges>(*scene_, *diffraction_edges_, folds_.fold_of_triangle, folds_.planes.size() + 1);
}

void AcousticSurfaces::average_absorption() {
  const TriangleMesh& mesh = scene_->mesh();
  std::vector<double> area(scene_->materials().size(), 0.0);
  double whole_m2 = 0;
  for (std::size_t t = 0; t < mesh.triangles.size(); ++t) {
    const glm::dvec3 a(mesh.vertices[mesh.triangles[t].x]), b(mesh.vertices[mesh.triangles[t].y]), c(mesh.vertices[mesh.triangles[t].z]);
    const double m2 = 0.5 * glm::length(glm::cross(b - a, c - a));
    area[mesh.triangle_material[t]] += m2;
    whole_m2 += m2;
  }
  mean_absorption_.assign(static_cast<std::size_t>(num_bands()), 0.0);
  for (std::size_t band = 0; whole_m2 > 0 && band < mean_absorption_.size(); ++band)
    for (std::uint32_t m = 0; m < area.size(); ++m) mean_absorption_[band] += area[m] / whole_m2 * (1.0 - reflectance(m)[band]);
}

std::size_t AcousticSurfaces::bytes() const {
  std::size_t sum = sizeof(AcousticSurfaces) + bytes_of(reflectance_) + bytes_of(scattering_) + bytes_of(transmission_) +
                    bytes_of(damping_) + bytes_of(impedance_) + bytes_of(kept_) + bytes_of(solid_) + bytes_of(planes_.planes) +
                    bytes_of(planes_.plane_of_triangle) + bytes_of(folds_.planes) + bytes_of(folds_.depth_m) + bytes_of(folds_.some_plane) +
                    bytes_of(folds_.fold_of_triangle);
  if (diffraction_edges_) sum += diffraction_edges_->bytes();
  for (const PanelEdges* edges : {panel_edges_.get(), fold_edges_.get()}) sum += edges ? edges->bytes() : 0;
  if (panel_shapes_) sum += panel_shapes_->bytes();
  return sum;
}

float AcousticSurfaces::largest_specular_reflectance() const {
  float largest = 0;
  for (std::uint32_t slot = 0; slot < scene_->materials().size(); ++slot)
    for (std::size_t band = 0; band < static_cast<std::size_t>(num_bands()); ++band)
      largest = std::max(largest, reflectance(slot)[band] * (1.f - scattering(slot)[band]));
  return largest;
}

}  // namespace earshot
