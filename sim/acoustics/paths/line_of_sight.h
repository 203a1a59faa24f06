// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <glm/geometric.hpp>
#include <glm/vec3.hpp>
#include <span>

#include "sim/acoustics/model/acoustic_scene.h"

namespace earshot {

/// Is the straight line between them free?  A pose decides it once, by this one ray: direct sound, transmission and diffraction take the
/// answer as an argument, so that they never contradict each other.  True for source == listener; swapped ends give the same answer.
inline bool in_line_of_sight(const AcousticScene& scene, glm::vec3 source, glm::vec3 listener) {
  return source == listener || !scene.scene().rays().occluded(listener, source);
}

/// Rays between a base and what it reflects to, past the panels that stand on it and have waves: their shadows are waves too, which grow
/// with frequency (EarlyCandidates::find_standing_waves).
class StandingPanels {
 public:
  /// panels: those that have waves, of scene.panel_shapes().
  StandingPanels(const AcousticScene& scene, std::span<const std::uint32_t> panels, std::uint32_t base_plane)
      : scene_(scene), panels_(panels), base_plane_(base_plane) {}
  /// The first thing that a ray meets but for those panels; its distance is that from the last of these.
  [[nodiscard]] Hit hit_past(glm::vec3 origin, glm::vec3 direction) const {
    Hit hit = scene_.scene().rays().intersect(origin, direction);
    for (int i = 0; i < kMost && hit.valid() && is_open(hit); ++i)
      hit = scene_.scene().rays().intersect(offset_from_surface(hit.position, -hit.normal), direction);
    return hit;
  }
  [[nodiscard]] bool is_free(glm::vec3 from, glm::vec3 to) const {
    const EmbreeScene& rays = scene_.scene().rays();
    if (!rays.occluded(from, to)) return true;
    for (int i = 0; i < kMost; ++i) {
      const float rest_m = glm::length(to - from);
      const Hit hit = rays.intersect(from, (to - from) / rest_m, rest_m);
      if (!hit.valid()) return true;
      if (!is_open(hit)) return false;
      from = offset_from_surface(hit.position, -hit.normal);
      if (!rays.occluded(from, to)) return true;
    }
    return false;
  }

 private:
  static constexpr int kMost = 16;
  [[nodiscard]] bool is_open(const Hit& hit) const {
    const std::uint32_t plane = scene_.plane_of_triangle()[hit.triangle];
    for (const std::uint32_t index : panels_) {
      const PanelShape& panel = scene_.panel_shapes()->all()[index];
      if (panel.stands() && panel.base_plane == base_plane_ && (panel.plane == plane || panel.back_plane == plane) &&
          panel.holds(glm::dvec3(hit.position)))
        return true;
    }
    return false;
  }

  const AcousticScene& scene_;
  std::span<const std::uint32_t> panels_;
  std::uint32_t base_plane_;
};

}  // namespace earshot
