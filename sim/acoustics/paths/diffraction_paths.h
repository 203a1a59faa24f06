// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <algorithm>
#include <cstdint>
#include <glm/vec3.hpp>
#include <span>
#include <vector>

#include "sim/acoustics/core/arrival.h"
#include "sim/acoustics/model/acoustic_scene.h"
#include "sim/acoustics/model/diffraction_budget.h"
#include "sim/acoustics/paths/edge_growth.h"
#include "sim/acoustics/paths/edge_path.h"

namespace earshot {

/// Edge sequences that may diffract the sound of one source position.  Immutable; shared by every listener pose of that source.
///
/// Sequences of one edge are those in sight of the source.  Longer ones are grown best first (least estimated loss) over edges in sight of
/// each other, within a bounded number of expansions (docs/evidence/stability.md, H-68); Kurze-Anderson losses at 500 Hz rank and cull,
/// never set an amplitude. Left out: edges in a row with a detour of more than two half waves (at 500 Hz) on the lit side, rims of one
/// sheet in a row.
class DiffractionCandidates {
 public:
  /// Nothing if config.diffraction is off or the scene has no edge in sight of the source.  About 0.1 us per edge of the scene and
  /// expansion, and the rays of the links that are tested (edge_growth.h).
  DiffractionCandidates(const AcousticScene& scene, glm::vec3 source);

  /// Inserts the strongest paths to `listener`, each segment confirmed by a ray, so that `arrivals` stays sorted by distance.
  ///
  /// Amplitude and phase per band at its centre: EdgePathField times 1 / (4 pi r) and air.  Faces reflect with the root of their specular
  /// reflectance, (1 - absorption)(1 - scattering), so that the field joins the image paths.  Source and listener swapped give the bits of
  /// the same distances, amplitudes and phases wherever both find the same sequences; where the shadow of a standing panel is part of
  /// `arrivals` (early_reflections.h), the same within rounding.  No allocation once `arrivals` has room for them.
  ///
  /// Behind a screen, paths are arrivals of their own, and their energy together is at most that of the sound that the screen holds back,
  /// the direct sound's.  In sight the energy of direct sound and images is complete without edges, which only move it about near shadow
  /// and reflection boundaries: there what the wave of a single edge does to the direct sound is added to it with its phase, and what goes
  /// on where an image has ended is an arrival.  (Images themselves have the size of their panels: panel_reflection.h.)  That weighs 1 up
  /// to a detour of a quarter of a wave, 0 from half a wave on (docs/explanation/effect_bounds.md, section 3); on a shadow boundary itself
  /// all single edges count, as they do behind it.  Many edges raise the direct sound by at most what one does, 1.4 dB.  Wedges blunter
  /// than 195 degrees take no part in reflections: images in their two faces overlap and gap by turns, and are that of a plane in the mean.
  /// With config.diffraction_reflections, paths that are reflected before or after their edges as well (edge_reflections.h).  in_sight: is
  /// the line from the source free (line_of_sight.h)?  Returns how many paths matter here.
  int find_arrivals(const AcousticScene& scene, glm::vec3 listener, bool in_sight, std::vector<Arrival>& arrivals) const;
  /// The same, with a ray of its own for the line of sight.
  int find_arrivals(const AcousticScene& scene, glm::vec3 listener, std::vector<Arrival>& arrivals) const;
  /// The same from another point near the source, by the sequences that were found from the source.
  int find_arrivals_from(const AcousticScene& scene, glm::vec3 point, glm::vec3 listener, bool in_sight,
                         std::vector<Arrival>& arrivals) const;

  [[nodiscard]] std::size_t size() const { return candidates_.size(); }
  /// Of PanelShapes::all(): panels in the air that send waves to every side (early_reflections.h), at most DiffractionBudget::panels, those
  /// that the source sees largest.  None without images: the tracers reflect the whole of a panel then.
  [[nodiscard]] std::span<const std::uint32_t> panels() const { return panels_; }
  [[nodiscard]] bool has_wave(std::uint32_t panel) const { return std::ranges::find(panels_, panel) != panels_.end(); }
  /// Does one of panels() stand on another surface?
  [[nodiscard]] bool has_standing() const { return has_standing_; }
  /// Bands of the scene as edges use them; empty without edges.
  [[nodiscard]] std::span<const EdgeBands> bands() const { return bands_; }

 private:
  /// Candidates that end with the same edge.
  struct Group {
    std::uint32_t last_edge;
    std::size_t begin, end;
    bool single;  ///< is a sequence of that edge alone among them?
  };
  class Search;
  /// Does the wave of a panel stand for the reflection of this face at its edge?
  [[nodiscard]] bool wave_has_face(const PanelShapes& shapes, std::uint32_t edge, bool first) const;

  glm::vec3 source_;
  std::vector<EdgeBands> bands_;
  DiffractionBudget budget_;               ///< of the config that this was made with
  std::vector<EdgeCandidate> candidates_;  ///< by group, strongest estimate first within each
  std::vector<std::uint32_t> panels_;
  bool has_standing_ = false;
  std::vector<Group> groups_;  ///< the one with the strongest candidate first
};

}  // namespace earshot
