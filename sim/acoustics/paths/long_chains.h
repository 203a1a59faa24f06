// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <vector>

#include "sim/acoustics/paths/facing_planes.h"
#include "sim/acoustics/paths/mirror_chains.h"

namespace earshot {

/// Specular paths of one source over more than image_order planes that are found as images: rows between parallel planes, and the strongest
/// chains between others.  Each estimator of the late field leaves out what carries_*() knows and adds add_late().
class LongChains {
 public:
  LongChains(const AcousticScene& scene, const SoundSource& source) : facing_(scene, source), mirrors_(scene, source, facing_) {}

  [[nodiscard]] bool empty() const { return facing_.empty() && mirrors_.empty(); }
  [[nodiscard]] const FacingPlanes& facing() const { return facing_; }
  [[nodiscard]] const MirrorChains& mirrors() const { return mirrors_; }

  /// Planes that a chain of mirrors has met so far, from either end.
  struct Chain {
    FacingPlanes::Chain facing;
    MirrorChains::Chain mirrors;
  };
  void extend(Chain& chain, std::uint32_t plane) const {
    facing_.extend(chain.facing, plane);
    if (!mirrors_.empty()) MirrorChains::extend(chain.mirrors, plane);
  }
  /// Does add_late() carry this chain of more than image_order planes, which came in the order from the source?
  [[nodiscard]] bool carries_from_source(const Chain& chain) const {
    return facing_.carries(chain.facing) || (!mirrors_.empty() && mirrors_.carries(chain.mirrors.from_source));
  }
  /// The same for the order from the listener.
  [[nodiscard]] bool carries_from_listener(const Chain& chain) const {
    return facing_.carries(chain.facing) || (!mirrors_.empty() && mirrors_.carries(chain.mirrors.from_listener));
  }

  void add_late(const AcousticScene& scene, glm::vec3 listener, EnergyHistogram& histogram) const {
    facing_.add_late(scene, listener, histogram);
    mirrors_.add_late(scene, listener, histogram);
  }

  /// Settings that, besides the scene, the source and image_order, decide which chains are carried; part of cache keys.
  [[nodiscard]] std::vector<std::uint32_t> rule() const {
    std::vector<std::uint32_t> numbers = facing_.rule();
    for (const std::uint32_t number : mirrors_.rule()) numbers.push_back(number);
    return numbers;
  }

 private:
  FacingPlanes facing_;
  MirrorChains mirrors_;
};

}  // namespace earshot
