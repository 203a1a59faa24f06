// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <glm/vec3.hpp>
#include <span>
#include <vector>

#include "sim/acoustics/core/energy_histogram.h"
#include "sim/acoustics/core/sound_source.h"
#include "sim/acoustics/geometry/exact_plane.h"
#include "sim/acoustics/model/acoustic_scene.h"
#include "sim/acoustics/paths/facing_planes.h"

namespace earshot {

/// Long specular paths of one source between mirrors at any angle: the strongest chains of more than image_order planes, as images.
///
/// Rays find such a chain by chance only, as its beam narrows with the square of its length.  Here beams find them (Heckbert and Hanrahan
/// 1984; Funkhouser et al. 1998): the beam of an image through the lit part of its last plane is clipped by every other plane, which gives
/// all chains that exist at some listener and a few more; the strongest are followed first, by their specular reflectance over the square
/// of their length, until kMaxChains are known.  What stands between is left to the rays that confirm each path.
///
/// The set depends on the source alone, so that every estimator of the late field can leave its chains out by carries_*(), and add_late()
/// carries them: nothing counts twice or is lost, whatever the number that is kept.  Rows of images between parallel planes are
/// FacingPlanes'.  empty() unless the source stands between two planes within 30 degrees of parallel whose reflections stand out of the
/// diffuse decay (mirror_decay.h).
class MirrorChains {
 public:
  static constexpr std::size_t kMaxChains = 4096, kFewChains = 512;  ///< few: with fewer than 512 rays

  /// About 20 us per chain, and 64 rays; nothing more without such planes.
  MirrorChains(const AcousticScene& scene, const SoundSource& source, const FacingPlanes& facing);

  [[nodiscard]] bool empty() const { return keys_.empty(); }
  [[nodiscard]] std::size_t size() const { return keys_.size(); }

  /// Planes that a chain of mirrors has met so far, as one number for either order: a polynomial in 2^64, whose terms are its planes.
  struct Chain {
    std::uint64_t from_source = 0, power = 1;  ///< if the planes came in the order from the source
    std::uint64_t from_listener = 0;           ///< if they came in the order from the listener
  };
  static void extend(Chain& chain, std::uint32_t plane) {
    const std::uint64_t term = (plane + 1) * 0x9E3779B97F4A7C15ull ^ (plane + 1) * 0xC2B2AE3D27D4EB4Full >> 29;
    chain.from_source += term * chain.power;
    chain.power *= kBase;
    chain.from_listener = term + kBase * chain.from_listener;
  }
  /// Does add_late() carry the chain with this number?
  [[nodiscard]] bool carries(std::uint64_t key) const;

  /// Adds the images that `listener` sees, air and the source's pattern included, up to the length of the RIR.  Cost: 0.02 us per chain,
  /// and a ray per reflection of those that are possible.  No allocation.
  void add_late(const AcousticScene& scene, glm::vec3 listener, EnergyHistogram& histogram) const;

  /// Two numbers that differ where the set does.
  [[nodiscard]] std::vector<std::uint32_t> rule() const;

 private:
  static constexpr std::uint64_t kBase = 0xD1342543DE82EF95ull;
  static constexpr std::uint32_t kSource = 0xFFFFFFFFu;  // parent of the first reflection
  struct Mirror {
    ExactPlane plane;
    MirrorPlane rounded;
  };
  struct Node {
    glm::dvec3 image;
    std::uint32_t parent, plane;
  };
  void grow(const AcousticScene& scene, const FacingPlanes& facing, std::size_t most);
  /// The path to `listener`: the fraction of energy per band, and the direction in which it leaves the source.  False if there is none.
  bool find_path(const AcousticScene& scene, std::uint32_t chain, glm::vec3 listener, std::span<double> kept, glm::dvec3& departure) const;

  SoundSource source_;
  Emission emission_;
  std::vector<Mirror> mirrors_;        ///< the largest planes of the scene
  std::vector<Node> nodes_;            ///< a tree: a chain is the way from its last plane to the source
  std::vector<std::uint32_t> chains_;  ///< of more than image_order planes, last nodes, strongest first
  std::vector<std::uint64_t> keys_;    ///< sorted
};

}  // namespace earshot
