// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <array>
#include <cstdint>
#include <glm/vec3.hpp>
#include <span>
#include <vector>

#include "sim/acoustics/core/bands.h"
#include "sim/acoustics/geometry/wall_facets.h"

namespace earshot {

class AcousticSurfaces;

/// Factor of the late energy at one end of a path, a source or a listener, that stands near walls.
struct WallGain {
  std::array<float, kMaxBands> energy{};  ///< per band; 1 where `any` is false
  bool any = false;                       ///< does any band differ from 1?
  WallGain() { energy.fill(1.f); }
  friend WallGain operator*(const WallGain& a, const WallGain& b) {
    WallGain product;
    for (std::size_t band = 0; band < product.energy.size(); ++band) product.energy[band] = a.energy[band] * b.energy[band];
    product.any = a.any || b.any;
    return product;
  }
};

/// Mean of sin(k d) / (k d) over the wavenumbers of a band, k from 2 pi low_hz / c to 2 pi high_hz / c, by the sine integral.  Absolute
/// error below 1e-5.  distance_m >= 0.
double band_mean_sinc(double low_hz, double high_hz, double distance_m, double speed_m_per_s);

/// Interference with the images in nearby walls (Waterhouse 1955, Interference patterns in reverberant sound fields: J. Acoust. Soc. Am.
/// 27, 247).  A source near a rigid wall radiates 1 + sin(2 k h) / (2 k h) of the power that it radiates in the free field, h from the
/// wall; in edges and corners the images of second and third order add theirs, so that a corner has 8 times the power.  By reciprocity the
/// mean square pressure of a diffuse field rises alike at a listener.  Energy tracers and source fields add the energies of a wave and of
/// its reflection, so the factor is that of the sum of pressures over the sum of energies:
///
///   1 + sum_i c_i S(2 h_i) + sum_ij c_i c_j S(2 r_ij) + sum_ijk c_i c_j c_k S(2 r_ijk),   c = 2 R / (1 + 1 - alpha),
///
/// R = sqrt((1 - alpha)(1 - scattering)), S the band mean of sin(k d) / (k d), r the distance from the edge or the corner.  Walls within a
/// wavelength of the lowest band count; those further off change a band by 0.1 dB at most, each.  Edges of another angle than 90 degrees:
/// the pair counts by 2 pi / angle - 3, exact at the edge (power 2 pi / angle) and at 90 degrees; edges sharper than 50 degrees do not
/// count.  Corners count where all three edges have 75 to 105 degrees.  The term of other corners is left out: where an edge of 50 degrees
/// meets a rigid floor the factor is 10.2 (10.1 dB) instead of 14.4 (11.6 dB).  Opposite walls have no common image here.
///
/// Surfaces that end in the air count by the connected piece that the foot lies on (wall_facets.h), a rectangle with distances d from the
/// foot to its free sides.  A single rigid half plane takes E(d, h) off the term of its mirror,
///
///   E = (1 + d / r) / 2 E0 + (1 - d / r) / 2 S(2 r),   r^2 = d^2 + h^2,   E0 = mean over the band of the integral of J1(t) / t from 2 k r,
///
/// where E0 is exact on the half plane (r = d) and the rest is within 0.03 of Sommerfeld's solution.  At the edge nothing is left of a
/// sheet's mirror and a third of that of a right-angled solid, whose E is 2/3 of this.  Sides count by the angle in the plane that they
/// fill as seen from the foot, half a turn in full: T = sum f E / pi.  The term of a piece is
///
///   D (S(2 h) - T + (T / 2)^4),   for T > 1 at least D min(S(2 h), 0),   D = 1 - exp(-(k l / 0.7)^2),   l = 1.06 b / E(b / a),
///
/// with half sides b <= a and the complete elliptic integral E, so that l is that of a small disc or strip (Rayleigh 1897), and the two
/// constants from boundary elements: rectangles of 0.1 to 1.6 waves within 0.1 dB, root mean square.  What stands on a floor has its
/// image there as a part of it.  Pairs and corners have D (1 - T + (T / 2)^4) of such a piece.  Pieces below 0.04 m2 do not
/// count, nor does a plane of many of them that are not connected (rows of small blocks).  Furniture beside the foot, holes, and outlines
/// that are no rectangles are left out.  Folded surfaces count as one mirror in bands in which image paths see one (folded_planes.h).
///
/// Patterns of sources play no part: where the factor matters the wave is longer than most sources, which then radiate alike all round.
///
/// Immutable; safe from any thread.
class WallPower {
 public:
  /// all_bands: false leaves bands alone that would change by less than kEffectBudgetDb, and walls and edges that add less than 0.013 dB.
  WallPower(const AcousticSurfaces& surfaces, bool all_bands);

  /// The factor at `point`, of the twelve planes that may matter most; a function of the scene and the point alone.  `surfaces`: those of
  /// the constructor.  Cost: 1 ns per plane, a ray for each wall, edge and corner that is near, and 0.3 us per wall
  /// that ends in the air: 2 to 5 us in a furnished room.  No allocation.
  [[nodiscard]] WallGain at(const AcousticSurfaces& surfaces, glm::vec3 point) const;

  [[nodiscard]] std::size_t bytes() const;

 private:
  static constexpr std::size_t kMaxNear = 12;
  struct Near;
  struct NearWalls;
  void find_walls(const AcousticSurfaces& surfaces, glm::dvec3 point, NearWalls& walls) const;
  void find_weights(const AcousticSurfaces& surfaces, NearWalls& walls) const;
  void end_in_air(Near& wall, glm::dvec3 point) const;
  [[nodiscard]] double look_up(const std::vector<float>& table, std::size_t band, double distance_m) const;
  [[nodiscard]] double mean_sinc(std::size_t band, double distance_m) const { return look_up(table_, band, distance_m); }

  bool all_bands_ = false;
  double least_effect_ = 0;  ///< of a wall or an edge that counts
  std::size_t num_bands_ = 0;
  double reach_m_ = 0;              ///< a wavelength of the lowest band
  std::vector<double> wavenumber_;  ///< [bands], at the centre
  std::vector<float> table_;        ///< [bands][kTableSize]: S over the wavenumber at the centre times the distance
  std::vector<float> edge_table_;   ///< the same of E0, over 2 r
  WallFacets facets_;
  std::array<std::vector<float>, 3> normal_, lower_, upper_;  ///< of each plane that is large enough, folds last
  std::vector<float> offset_m_, plane_reach_m_;
  std::vector<float> size_;           ///< [planes][bands]: about what they may add, by the area
  std::vector<std::uint32_t> plane_;  ///< planes().size() and more: a fold
};

}  // namespace earshot
