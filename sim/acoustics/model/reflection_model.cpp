// SPDX-License-Identifier: Apache-2.0
#include "sim/acoustics/model/reflection_model.h"

#include <algorithm>
#include <glm/geometric.hpp>
#include <numbers>

#include "sim/acoustics/model/specular_lobe.h"

namespace earshot {

ReflectionModel::ReflectionModel(const AcousticSurfaces& surfaces, bool transmission)
    : stride_(static_cast<std::size_t>(surfaces.padded_bands())), lobe_(surfaces.specular_lobe()) {
  const std::size_t num_materials = surfaces.scene().materials().size();
  const auto num_bands = static_cast<std::size_t>(surfaces.num_bands());
  rows_.assign(num_materials * 4 * stride_, 0.f);
  mean_.resize(num_materials);
  for (std::uint32_t material = 0; material < num_materials; ++material) {
    float* kept = &rows_[std::size_t{material} * 4 * stride_];
    float *diffuse = kept + stride_, *specular = diffuse + stride_, *transmitted = specular + stride_;
    Means& mean = mean_[material];
    for (std::size_t b = 0; b < num_bands; ++b) {
      const float reflectance = surfaces.reflectance(material)[b], scattering = surfaces.scattering(material)[b];
      const float tau = transmission ? surfaces.transmission(material)[b] : 0.f;
      kept[b] = reflectance + tau;
      const float reflected_fraction = tau > 0.f ? reflectance / kept[b] : 1.f;
      diffuse[b] = reflected_fraction * scattering;
      specular[b] = reflected_fraction * (1.f - scattering);
      transmitted[b] = tau > 0.f ? tau / kept[b] : 0.f;
      mean.diffuse += diffuse[b] / static_cast<float>(num_bands);
      mean.specular += specular[b] / static_cast<float>(num_bands);
      mean.transmitted += transmitted[b] / static_cast<float>(num_bands);
    }
  }
}

float ReflectionModel::specular_value(glm::vec3 normal, glm::vec3 in, glm::vec3 out) const {
  return lobe_ ? lobe_->value(normal, in, out) : 0.f;
}

float ReflectionModel::mean_pdf(std::uint32_t material, glm::vec3 normal, glm::vec3 in, glm::vec3 out) const {
  const Means& mean = mean_[material];
  // Not zero at grazing angles: quotients of densities are formed.
  const float cosine = std::max(glm::dot(normal, out), 1e-7f);
  const float lambert = mean.diffuse * cosine / std::numbers::pi_v<float>;
  return lobe_ && mean.specular > 0.f ? lambert + mean.specular * lobe_->pdf(normal, in, out) : lambert;
}

}  // namespace earshot
