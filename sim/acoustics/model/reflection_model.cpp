// SPDX-License-Identifier: Apache-2.0
#include "sim/acoustics/model/reflection_model.h"

#include <algorithm>
#include <array>
#include <glm/geometric.hpp>
#include <numbers>

#include "sim/acoustics/model/lobe_shares.h"
#include "sim/acoustics/model/specular_lobe.h"

namespace earshot {

ReflectionModel::ReflectionModel(const AcousticSurfaces& surfaces, bool transmission)
    : stride_(static_cast<std::size_t>(surfaces.padded_bands())) {
  const std::size_t num_materials = surfaces.scene().materials().size();
  const auto num_bands = static_cast<std::size_t>(surfaces.num_bands());
  const auto lobes = surfaces.specular_lobes();
  const bool from_scattering = lobes.size() == kLobeLadder;
  rows_.assign(num_materials * 4 * stride_, 0.f);
  mean_.resize(num_materials);
  std::array<float, kMaxBands> reflected_fraction;
  std::array<std::array<float, kMaxBands>, kLobeLadder> share;
  for (std::uint32_t material = 0; material < num_materials; ++material) {
    float* kept = &rows_[std::size_t{material} * 4 * stride_];
    float *diffuse = kept + stride_, *mirror = diffuse + stride_, *transmitted = mirror + stride_;
    Means& mean = mean_[material];
    for (std::size_t b = 0; b < num_bands; ++b) {
      const float reflectance = surfaces.reflectance(material)[b], scattering = surfaces.scattering(material)[b];
      const float tau = transmission ? surfaces.transmission(material)[b] : 0.f;
      LobeShares shares{.diffuse = scattering, .mirror = lobes.empty() ? 1.f - scattering : 0.f};
      if (from_scattering)
        shares = shares_of_scattering(scattering);
      else
        shares.lobe[0] = 1.f - scattering;
      kept[b] = reflectance + tau;
      reflected_fraction[b] = tau > 0.f ? reflectance / kept[b] : 1.f;
      diffuse[b] = reflected_fraction[b] * shares.diffuse;
      mirror[b] = reflected_fraction[b] * shares.mirror;
      for (std::size_t i = 0; i < lobes.size(); ++i) share[i][b] = shares.lobe[i];
      transmitted[b] = tau > 0.f ? tau / kept[b] : 0.f;
      mean.diffuse += diffuse[b] / static_cast<float>(num_bands);
      mean.mirror += mirror[b] / static_cast<float>(num_bands);
      mean.transmitted += transmitted[b] / static_cast<float>(num_bands);
    }
    first_lobe_.push_back(lobes_.size());
    for (std::size_t i = 0; i < lobes.size(); ++i)
      if (lobes[i]) add_lobe(lobes[i].get(), std::span(share[i]).first(num_bands), reflected_fraction);
  }
  first_lobe_.push_back(lobes_.size());
}

void ReflectionModel::add_lobe(const SpecularLobe* lobe, std::span<const float> share, std::span<const float> reflected_fraction) {
  Lobe added{.lobe = lobe, .row = lobe_rows_.size(), .mean = 0};
  lobe_rows_.resize(added.row + stride_, 0.f);
  for (std::size_t b = 0; b < share.size(); ++b) {
    lobe_rows_[added.row + b] = reflected_fraction[b] * share[b];
    added.mean += lobe_rows_[added.row + b] / static_cast<float>(share.size());
  }
  if (added.mean > 0.f)
    lobes_.push_back(added);
  else
    lobe_rows_.resize(added.row);
}

float ReflectionModel::mean_pdf(std::uint32_t material, glm::vec3 normal, glm::vec3 in, glm::vec3 out) const {
  // Not zero at grazing angles: quotients of densities are formed.
  const float cosine = std::max(glm::dot(normal, out), 1e-7f);
  float density = mean_[material].diffuse * cosine / std::numbers::pi_v<float>;
  for (const Lobe& lobe : lobes(material)) density += lobe.mean * lobe.lobe->pdf(normal, in, out);
  return density;
}

}  // namespace earshot
