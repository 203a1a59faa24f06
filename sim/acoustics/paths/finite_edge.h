// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <array>
#include <glm/vec3.hpp>

#include "sim/acoustics/geometry/diffraction_edges.h"
#include "sim/acoustics/paths/utd.h"

namespace earshot {

/// exp(j u^2) times (b / pi) times the integral of exp(-j t^2) / (t^2 + b^2) over t from u to infinity; u, b >= 0.  At u = 0 it is half of
/// scaled_erfc(b): each term of the uniform theory is this integral over the whole line, so that it is what the edge past its end at u
/// contributes.  own_erfc: scaled_erfc(b); end_erfc: scaled_erfc(u); least_u: the least u of all lanes.  Error below 2e-3 of 1 / (1 + u)
/// everywhere.  Near its end about 30 ns for all lanes, 3 ns where u >= 2.75 in all.
ComplexLanes edge_tail(const Lanes& u, const Lanes& b, const ComplexLanes& own_erfc, const ComplexLanes& end_erfc, float least_u);

/// No wave over the edge exceeds this fraction of a free path by its nearest point: each term's integral without its phase, which is the
/// angle arctan(u / b) between the ends, whatever the frequency.  For culling; about 0.2 us.
double largest_ratio(const DiffractionEdge& edge, glm::dvec3 before, glm::dvec3 after);

/// A wedge of finite length, for one source and one listener.
///
/// The diffracted field is the line integral along the edge of Svensson, Fred and Vanderkooy 1999 (J. Acoust. Soc. Am. 106, eqs. 15 to
/// 18), exp(-j k R(z)) beta(z) / (m l) dz.  With k (R(z) - R0) = t^2 (R0: by the point of the edge's line where the way is shortest) a term
/// of it is q(t) exp(-j t^2) dt, and the uniform theory is what follows from q(t) = weight b / (pi (t^2 + b^2)) on the whole line
/// (utd.h: b = sqrt(2 k L) |sin(d / 2)|).  Here the integral stops at the edge's ends, u = sqrt(k detour), in closed form (edge_tail), and
/// the q of the line integral less that of the theory, 0 at t = 0, is added there by its leading term.  So phases are exact at both ends,
/// an edge short against the wave scatters in proportion to its length, and pieces of one edge add up to the whole.
///
/// Error against the line integral (docs/evidence/validation.md): 1 dB, or 1.5 % of the free field.  Corners radiate nothing of their own,
/// and edges of one object do not see each other here.
class FiniteWedge {
 public:
  FiniteWedge() = default;
  /// before, after: the ends of the way over this edge.
  FiniteWedge(const DiffractionEdge& edge, glm::dvec3 before, glm::dvec3 after);
  /// With DiffractionEdge::angle_of of both ends, where they are known.
  FiniteWedge(const DiffractionEdge& edge, glm::dvec3 before, glm::dvec3 after, double before_rad, double after_rad);

  /// Field over that of a free path by the nearest point of the edge to the shortest way: by R0, or by the end where that is past it.
  /// length_m: L of the terms; own_length_m() unless several edges share a path.
  [[nodiscard]] ComplexLanes ratio(const WaveLanes& wave, double length_m, const FaceFactorLanes& faces) const;
  /// The endless wedge.
  [[nodiscard]] const WedgeDiffraction& endless() const { return wedge_; }
  /// How much longer the way over the edge is than the straight one (term 0) or that by the mirror image in its first (2) or second face
  /// (3), about: exact at their boundaries, where it is 0.
  [[nodiscard]] double detour_m(std::size_t term) const {
    return 2.0 * own_length_m_ * wedge_.boundary(term) * wedge_.boundary(term) +
           (past_end_ < 0 ? 0.0 : ends_[static_cast<std::size_t>(past_end_)].detour_m);
  }
  void set_in_sight(bool in_sight) { wedge_.set_in_sight(in_sight); }
  /// L = s s' sin^2(beta) / (s + s').
  [[nodiscard]] double own_length_m() const { return own_length_m_; }

 private:
  struct End {
    double detour_m = 0, root_of_detour = 0;  ///< of the way by this end
    std::array<double, 4> residue{};          ///< sqrt(k) times the q of the line integral less that of the theory, per term
  };
  WedgeDiffraction wedge_;
  double own_length_m_ = 0;
  std::array<End, 2> ends_;
  int past_end_ = -1;  ///< the shortest way lies past this one of the two
};

}  // namespace earshot
