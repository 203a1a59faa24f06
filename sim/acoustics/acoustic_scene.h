#pragma once

#include <array>
#include <cstdint>
#include <glm/vec3.hpp>
#include <memory>
#include <span>
#include <vector>

#include "sim/acoustics/bands.h"
#include "sim/acoustics/quality.h"
#include "sim/scene/scene.h"

namespace earshot {

/// A group of coplanar triangles of one facing: what an image source mirrors in.
struct MirrorPlane {
  glm::vec3 normal;    ///< unit
  float offset_m;      ///< dot(normal, x) on the plane
  float area_m2;
  std::uint32_t material;  ///< slot with the largest area on it
};

/// A scene seen through one acoustic configuration: coefficients per band, air, planes.  Immutable, shared by all threads; holds the
/// scene alive.
class AcousticScene {
 public:
  AcousticScene(std::shared_ptr<const Scene> scene, const AcousticConfig& config);

  [[nodiscard]] const Scene& scene() const { return *scene_; }
  [[nodiscard]] const AcousticConfig& config() const { return config_; }
  [[nodiscard]] const BandLayout& bands() const { return bands_; }
  [[nodiscard]] int num_bands() const { return bands_.size(); }
  /// Per material slot and band: [num_bands] each.
  [[nodiscard]] std::span<const float> reflectance(std::uint32_t material) const;   ///< 1 - absorption
  [[nodiscard]] std::span<const float> scattering(std::uint32_t material) const;
  [[nodiscard]] std::span<const float> transmission(std::uint32_t material) const;
  [[nodiscard]] float mean_scattering(std::uint32_t material) const;                ///< over bands: picks the lobe
  /// Energy exponent of air per band, all zero if air absorption is off.
  [[nodiscard]] std::span<const float> air_energy_per_m() const { return air_; }
  [[nodiscard]] std::span<const MirrorPlane> planes() const { return planes_; }
  [[nodiscard]] std::span<const std::uint32_t> plane_of_triangle() const { return plane_of_triangle_; }
  [[nodiscard]] float speed_of_sound_m_per_s() const { return scene_->speed_of_sound_m_per_s(); }
  /// Identity of everything that decides bits: scene hash and config.
  [[nodiscard]] std::uint64_t hash() const { return hash_; }

 private:
  std::shared_ptr<const Scene> scene_;
  AcousticConfig config_;
  BandLayout bands_;
  std::vector<float> reflectance_, scattering_, transmission_, mean_scattering_, air_;
  std::vector<MirrorPlane> planes_;
  std::vector<std::uint32_t> plane_of_triangle_;
  std::uint64_t hash_ = 0;
};

}  // namespace earshot
