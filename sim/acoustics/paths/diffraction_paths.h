#pragma once

#include <cstdint>
#include <glm/vec3.hpp>
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
/// each other, within a bounded number of expansions (docs/stability.md, H-68); Kurze-Anderson losses at 500 Hz rank and cull, never set an
/// amplitude. Left out: paths that mix reflections and edges, edges in a row with a detour of more than two half waves (at 500 Hz) on the
/// lit side, rims of one sheet in a row.
class DiffractionCandidates {
 public:
  /// Nothing if config.diffraction is off or the scene has no edge in sight of the source.  About 0.1 us per edge of the scene and
  /// expansion, and the rays of the links that are tested (edge_growth.h).
  DiffractionCandidates(const AcousticScene& scene, glm::vec3 source);

  /// Inserts the strongest paths to `listener`, each segment confirmed by a ray, so that `arrivals` stays sorted by distance.
  ///
  /// Amplitude and phase per band at its centre: EdgePathField times 1 / (4 pi r) and air.  Faces reflect with the root of their specular
  /// reflectance, (1 - absorption)(1 - scattering), so that the field joins the image paths.  In sight of the source the diffracted sound
  /// has the sign, in its phase, that takes from the direct sound.  The energy of all of them together is kept below that of the
  /// unobstructed direct sound + 6 dB.  Source and listener swapped give the bits of the same distances, amplitudes and phases wherever
  /// both find the same sequences.  No allocation once `arrivals` has room for them. in_sight: is the line from the source free
  /// (line_of_sight.h)?
  void find_arrivals(const AcousticScene& scene, glm::vec3 listener, bool in_sight, std::vector<Arrival>& arrivals) const;
  /// The same, with a ray of its own for the line of sight.
  void find_arrivals(const AcousticScene& scene, glm::vec3 listener, std::vector<Arrival>& arrivals) const;

  [[nodiscard]] std::size_t size() const { return candidates_.size(); }

 private:
  /// Candidates that end with the same edge.
  struct Group {
    std::uint32_t last_edge;
    std::size_t begin, end;
    bool single;  ///< is a sequence of that edge alone among them?
  };
  bool find_path(const AcousticScene& scene, const EdgeCandidate& candidate, glm::vec3 listener, bool in_sight, double weakest_db,
                 int& attempts, Arrival& arrival) const;

  glm::vec3 source_;
  DiffractionBudget budget_;               ///< of the config that this was made with
  std::vector<EdgeCandidate> candidates_;  ///< by group, strongest estimate first within each
  std::vector<Group> groups_;              ///< the one with the strongest candidate first
};

}  // namespace earshot
