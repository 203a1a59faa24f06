// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <array>
#include <cstdint>
#include <glm/vec3.hpp>
#include <memory>
#include <span>
#include <vector>

#include "sim/acoustics/core/arrival.h"
#include "sim/acoustics/core/sound_source.h"
#include "sim/acoustics/model/acoustic_scene.h"
#include "sim/acoustics/model/plane_cells.h"
#include "sim/acoustics/paths/diffraction_paths.h"
#include "sim/acoustics/paths/long_chains.h"

namespace earshot {

/// Does the source stay where it is for many poses of the listener, or is each of its places used a few times?
enum class SourceMotion { rests, moves };

/// Image-source candidates of one source position: the plane sequences that specular rays from it meet, plus, in scenes of few planes
/// (at most 2048 sequences of that order), all sequences.  Immutable; shared by every listener pose and episode of that source.
/// Image sources: Allen and Berkley 1979 for a box, Borish 1984 for any polyhedron.
class EarlyCandidates {
 public:
  /// Cost: config.early_candidate_rays times early_order rays, and the diffraction paths (diffraction_paths.h): 3 to 6 ms
  /// in a house.
  /// motion: a source that moves takes most plane sequences from those of its cell (plane_cells.h), which are found once in a metre, and
  /// traces an eighth of the rays itself: a fifth of the time, and at least as many sequences.  Still a function of (scene, source).
  EarlyCandidates(const AcousticScene& scene, const SoundSource& source, SourceMotion motion = SourceMotion::rests);
  /// Appends the valid arrivals at `listener`: direct sound if `in_sight` (line_of_sight.h), then image paths whose every segment is
  /// confirmed by a ray. A path through the edge of two planes, which two sequences find, counts once.  Arrivals that carry no energy
  /// (fully absorbing or fully scattering surfaces) or come after config.rir_length_s are left out.  The appended part is sorted by
  /// (distance, plane sequence): same input, same bits.  Source and listener swapped give the bits of the same distances and amplitudes,
  /// but where a panel that stands on another casts a shadow (find_standing_waves): there the same within rounding.
  /// A folded surface (folded_planes.h) is one mirror in bands in which the ways between its top and bottom differ by an eighth of a wave
  /// at most, the planes that it consists of from a quarter on.
  void find_arrivals(const AcousticScene& scene, glm::vec3 listener, bool in_sight, std::vector<Arrival>& arrivals) const;
  /// Planes that end in the air reflect by their size (panel_reflection.h); what no panel reflects passes round it.  `scattered` gets, as
  /// arrivals, of longer images what panels reflect but not here, and of one plane without a wave of its own (find_panel_waves) what it
  /// does not reflect here if its edges are left out (DiffractionBudget::near_boundary_only).  Null: that energy is lost.
  void find_arrivals(const AcousticScene& scene, glm::vec3 listener, bool in_sight, std::vector<Arrival>& arrivals,
                     std::vector<Arrival>* scattered) const;
  /// The same, with a ray of its own for the line of sight.
  void find_arrivals(const AcousticScene& scene, glm::vec3 listener, std::vector<Arrival>& arrivals) const;
  /// Appends what the panels in the air that the source sees largest (DiffractionCandidates::panels) send to their sides, unsorted: one
  /// wave of each whose point of reflection is off the panel.  Part of find_arrivals if in_sight.  with_standing: find_standing_waves
  /// follows, so that panels that stand on others do not hide them.  At most kMostPanelPaths of each kind; energy of weaker ones, and of
  /// those 40 dB below the direct sound in all bands, is `scattered`.  A wave is lost where something hides the point of its panel that is
  /// nearest to that of reflection.
  void find_panel_waves(const AcousticScene& scene, glm::vec3 listener, bool with_standing, std::vector<Arrival>& arrivals,
                        std::vector<Arrival>* scattered) const;
  /// The same of thin panels that stand on another surface (PanelShape::stands), in place of their images and of images by one reflection
  /// in their base as well: to their side of the source from the source and from its image in the base, whether images are in sight or
  /// not, each if both ends see its point of the panel; on their other side the same with the opposite sign is the shadow, which joins
  /// direct sound and the reflection of the base. After find_panel_waves; part of find_arrivals if in_sight.
  void find_standing_waves(const AcousticScene& scene, glm::vec3 listener, std::vector<Arrival>& arrivals,
                           std::vector<Arrival>* scattered) const;
  /// Direct sound of a point in sight, without its emission.  False where it comes after config.rir_length_s, or direct sound is off.
  static bool set_direct(const AcousticScene& scene, glm::vec3 source, glm::vec3 listener, Arrival& direct);
  /// Is this plane sequence, in the order from the source, among the candidates?  Then image paths carry its specular energy.
  [[nodiscard]] bool contains(std::span<const std::uint32_t> planes) const;
  [[nodiscard]] glm::vec3 source() const { return source_.position; }
  [[nodiscard]] const SoundSource& sound_source() const { return source_; }
  [[nodiscard]] const Emission& emission() const { return emission_; }
  [[nodiscard]] std::size_t size() const { return sequences_.size(); }
  /// Images of longer sequences, which are part of every late field; null where there are none.
  [[nodiscard]] const std::shared_ptr<const LongChains>& long_chains() const { return long_chains_; }
  /// Factor of the late energy of this source: that of walls near it (AcousticScene::wall_gain).
  [[nodiscard]] const WallGain& wall_gain() const { return wall_gain_; }
  /// Diffraction paths of the same source.
  [[nodiscard]] const DiffractionCandidates& diffraction() const { return diffraction_; }

 private:
  static constexpr int kMaxOrder = PlaneSequence::kMaxOrder;
  static constexpr std::size_t kMostPanelPaths = 6;
  using Sequence = PlaneSequence;
  /// Mirrors the source in all sequences and notes their last planes.
  void find_images(const AcousticScene& scene);
  /// Appends the sequences in which folds stand for their planes.
  void add_folds(const AcousticScene& scene);
  /// Of a path that meets the planes `met`, in the triangles' folds `fold`: the fraction of its energy per band that it carries, as a path
  /// by folds or by their planes.  The two share what there is.  False if none.
  bool weigh_folds(const AcousticScene& scene, std::span<const std::uint32_t> met, std::span<const std::uint32_t> fold, bool by_folds,
                   glm::vec3 listener, std::span<double> energy_fraction) const;
  [[nodiscard]] bool find_sequence(std::span<const std::uint32_t> planes, std::size_t begin, std::size_t end) const;
  /// with_standing: panels that stand on others have waves in place of this path.
  bool find_path(const AcousticScene& scene, std::size_t index, glm::vec3 listener, bool with_standing, Arrival& arrival,
                 Arrival& scattered) const;
  /// Has a wave of find_standing_waves the reflection by these planes, at these points?
  [[nodiscard]] bool is_standing_wave(const AcousticScene& scene, std::span<const std::uint32_t> planes,
                                      std::span<const glm::dvec3> points) const;
  /// Of the arrivals from `first` on: weak ones, and all but the strongest, become `scattered`.
  void keep_strongest(const AcousticScene& scene, glm::vec3 listener, std::size_t first, std::vector<Arrival>& arrivals,
                      std::vector<Arrival>* scattered) const;
  /// Candidates for the images of panels that have waves, which rays may miss: what has no candidate is the tracers'.
  void append_panels(const AcousticScene& scene);
  /// Marks the sequences from `first` on whose last segment is possible, by the sides of the last plane and its bounds, for all poses in
  /// one plain loop that lets pass a little more than find_path does.
  void cull(std::size_t first, glm::dvec3 listener, std::span<std::uint8_t> possible) const;

  SoundSource source_;
  Emission emission_;
  WallGain wall_gain_;
  DiffractionCandidates diffraction_;
  std::shared_ptr<const LongChains> long_chains_;
  /// Sorted and unique, those by planes before those by folds, which count as planes from planes().size() on.
  std::vector<Sequence> sequences_;
  std::size_t num_by_planes_ = 0;
  std::vector<glm::dvec3> images_;  ///< the source mirrored in all planes of the sequence
  /// Of the last plane of each sequence, one array per quantity: unit normal, offset, height of the image, bounds; and the image.
  struct LastPlanes {
    std::array<std::vector<double>, 3> normal, image, lower, upper;
    std::vector<double> offset_m, image_height_m;
  } last_;
};

}  // namespace earshot
