// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <array>
#include <cstdint>
#include <glm/vec3.hpp>
#include <span>
#include <vector>

#include "sim/acoustics/core/energy_histogram.h"
#include "sim/acoustics/core/sound_source.h"
#include "sim/acoustics/model/acoustic_scene.h"

namespace earshot {

/// Flutter echoes: specular paths of one source that go back and forth between two parallel planes that face each other, to any order.
///
/// Rays find such paths by chance only: after the distance r they lie within a solid angle of the planes' area over r^2.  As images they
/// are a row of points (Allen and Berkley 1979, one dimension of it), and reflections in planes at right angles to the two commute with
/// that row: a path of n bounces between the two and a sequence S of side planes has the length hypot(n d + offset, distance across by S)
/// whatever the order of its bounces.  So one family (pair, S) needs one test of what it sweeps, for all n: the strip between the planes
/// over the line that the path draws across them.
///
/// A chain of mirrors belongs to a family here if it has at least image_order + 1 bounces on one pair and at most max_sides on its side
/// planes; then add_late() carries it, and every estimator of the late field leaves it out by carries().  With fewer bounces on each pair
/// it is an image path (EarlyCandidates) or the estimator's.  Only pairs that the source stands between, and whose flutter stands out of a
/// diffuse decay by a decibel where that has fallen by 35 dB, the end of T30, are kept; empty() in ordinary rooms and where a bounce
/// costs more than 40 % of the energy.  Planes with a triangle that reflects by the angle are in no pair and no side plane.
class FacingPlanes {
 public:
  static constexpr std::size_t kMaxPairs = 3;
  static constexpr std::size_t kMaxPlanes = 64;  ///< the largest of the scene are looked at
  static constexpr double kParallelSine = 1e-4;  ///< of the angle between planes that count as parallel, or at right angles
  static constexpr int kManyRays = 512;          ///< below, the noise is larger than what further chains add

  /// Up to 128 rays, and nothing more where no pair is kept.
  FacingPlanes(const AcousticScene& scene, const SoundSource& source);

  [[nodiscard]] bool empty() const { return pairs_.empty(); }
  [[nodiscard]] std::size_t size() const { return pairs_.size(); }

  /// Planes that a chain of mirrors has met so far, from either end.
  struct Chain {
    std::array<std::uint16_t, kMaxPairs> bounces{};  ///< on the planes of each pair
    std::array<std::uint8_t, kMaxPairs> sides{};     ///< on its side planes
    std::uint8_t broken = 0;                         ///< bit per pair: met something else
  };
  void extend(Chain& chain, std::uint32_t plane) const {
    for (std::size_t i = 0; i < pairs_.size(); ++i) {
      const std::uint8_t role = pairs_[i].role[plane];
      if (role == kEnd) {
        chain.bounces[i] = static_cast<std::uint16_t>(chain.bounces[i] < 0xFFFF ? chain.bounces[i] + 1 : 0xFFFF);
      } else if (role == kSide && chain.sides[i] < pairs_[i].max_sides) {
        ++chain.sides[i];
      } else {
        chain.broken |= static_cast<std::uint8_t>(1u << i);
      }
    }
  }
  /// Does add_late() carry this chain?
  [[nodiscard]] bool carries(const Chain& chain) const {
    for (std::size_t i = 0; i < pairs_.size(); ++i)
      if (chain.bounces[i] >= least_bounces_ && (chain.broken >> i & 1u) == 0) return true;
    return false;
  }

  /// Adds the energy of all families at `listener`, air and the source's pattern included, up to the length of the RIR.  Exact where a
  /// strip is free over its whole length (materials: geometric mean over the strip); where something stands in it, paths of up to
  /// kTracedBounces bounces are followed one by one and of longer ones two in each run of a quarter more bounces, which tell how many of
  /// the run come through.  What is narrower than 0.25 m across the strip may go unseen.  Cost: about 40 rays per family, 8 more per metre
  /// of it beyond 3 m, some hundred where it is obstructed; 0.1 us per path and band.  No allocation.
  void add_late(const AcousticScene& scene, glm::vec3 listener, EnergyHistogram& histogram) const;

  static constexpr int kTracedBounces = 12;

  /// Settings that, besides the scene, the source and image_order, decide which chains are carried; part of cache keys.
  [[nodiscard]] std::vector<std::uint32_t> rule() const;

 private:
  enum Role : std::uint8_t { kNone, kEnd, kSide };
  static constexpr int kMaxSides = 4;
  using Sequence = std::array<std::uint32_t, kMaxSides>;
  struct Pair {
    std::array<std::uint32_t, 2> plane;
    glm::dvec3 axis;                 ///< unit, from plane 0 to plane 1
    double offset_m = 0, gap_m = 0;  ///< dot(axis, x) on plane 0; distance of plane 1
    int max_sides = 0;
    std::vector<std::uint8_t> role;   ///< [planes]
    std::vector<std::uint32_t> side;  ///< planes at right angles
  };
  class Family;
  void find_pairs(const AcousticScene& scene);
  void find_sides(const AcousticScene& scene, const std::vector<bool>& by_angle, Pair& pair) const;
  void add_families(const AcousticScene& scene, const Pair& pair, glm::dvec3 listener, Sequence& sides, int num_sides,
                    EnergyHistogram& histogram) const;
  void add_family(const AcousticScene& scene, const Pair& pair, glm::dvec3 listener, std::span<const std::uint32_t> sides,
                  EnergyHistogram& histogram) const;

  SoundSource source_;
  Emission emission_;
  std::uint16_t least_bounces_ = 0;
  std::vector<Pair> pairs_;
};

}  // namespace earshot
