// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <array>
#include <cmath>

#include "sim/acoustics/paths/band_lanes.h"

namespace earshot {

/// exp(z^2) erfc(z) on the ray z = u exp(j pi / 4), 0 <= u <= 1e5: 1 at u = 0, falling as 1 / (sqrt(pi) z).  Relative error below 4e-6, by
/// one rational function for each part.  About 10 ns for all lanes.  All of the uniform theory rests on it: the Fresnel integral of a
/// knife edge is half of it, and the transition function of Kouyoumjian and Pathak is F(x) = sqrt(pi x) exp(j pi / 4) times it at
/// u = sqrt(x).  Convention exp(+j w t).
ComplexLanes scaled_erfc(const Lanes& u);

/// Pressure factors of a wedge's faces on the terms of its diffracted field, in [0, 1] per band.
struct FaceFactorLanes {
  Lanes first{}, second{};  ///< reflection: of the terms that make up for reflections which end (Luebbers 1984, IEEE Trans. AP 32, 70-76)
  Lanes incidence{};        ///< 1 - sqrt(tau): of the jump of the sound past the edge, which passes the wedge as sqrt(tau) (Babinet)
};

/// A rigid wedge for one source direction and one listener direction: uniform theory of diffraction (Kouyoumjian and Pathak 1974,
/// Proc. IEEE 62, eqs. 25 to 32), written without the product of an infinite cotangent and a vanishing transition function.
///
/// With x_i = sqrt(2 k L) |sin(d_i / 2)| and d_i the angle from the i-th shadow or reflection boundary, each term of the theory is
///   cot(d_i / 2n) F(x_i^2) = sign(d_i) sqrt(2 pi k L) exp(j pi / 4) [sin(|d_i| / 2) / tan(|d_i| / 2n)] scaled_erfc(x_i),
/// and the bracket tends to n at the boundary: nothing to expand there.  Divided by the field at the length of the whole path the
/// diffracted field is the sum below, whose terms are at most 1/2 each, so that it stays finite down to kL = 0.
///
/// Error against the exact wedge (docs/evidence/oracles.md, O-24): 0.06 dB for a thin screen from 63 Hz on, 0.26 dB at 63 Hz for a 270
/// degree corner.
class WedgeDiffraction {
 public:
  WedgeDiffraction() = default;  ///< diffracts nothing
  /// exterior_rad: angle of the air, in (pi, 2 pi].  Angles of source and listener from the first face through the air, in [0, exterior].
  /// Swapped, they give the same bits.
  WedgeDiffraction(double exterior_rad, double source_rad, double listener_rad);

  /// Diffracted pressure over that of a free path as long as the one over the edge, at most 2, within 1e-5.
  /// root_of_two_wave_lengths: sqrt(2 k L) with L = s s' sin^2(beta) / (s + s'), up to 1e5.
  [[nodiscard]] ComplexLanes ratio(const Lanes& root_of_two_wave_lengths, const FaceFactorLanes& faces) const;

  /// Rounding decides on which side of the shadow boundary a pose within 3e-5 rad of it lies: on that of the line of sight.
  void set_in_sight(bool in_sight) {
    if (std::abs(from_boundary_[0]) < 3e-5) weight_[0] = in_sight ? -std::abs(weight_[0]) : std::abs(weight_[0]);
  }

  /// How far the path deviates from a straight one: 0 on the shadow boundary, up to 1.
  [[nodiscard]] double deviation() const { return boundary_[0]; }

  /// Of the four terms (incidence, incidence round the back, first face, second face): factor, |sin(d / 2)| and d.
  [[nodiscard]] double weight(std::size_t term) const { return weight_[term]; }
  [[nodiscard]] double boundary(std::size_t term) const { return boundary_[term]; }
  [[nodiscard]] double from_boundary(std::size_t term) const { return from_boundary_[term]; }

 private:
  std::array<double, 4> weight_{};         ///< -sign(d) [..] / 2n: incidence, incidence round the back, first face, second face
  std::array<double, 4> boundary_{};       ///< |sin(d / 2)|
  std::array<double, 4> from_boundary_{};  ///< d
};

/// Loss in dB of a thin screen at Fresnel number n >= 0 (Kurze and Anderson 1971): 5 + 20 log10(sqrt(2 pi n) / tanh(sqrt(2 pi n))).  Within
/// 3 dB of the exact thin screen; at a 270 degree corner up to 4.1 dB too much (docs/evidence/oracles.md, O-24), so good for ranking only.
double kurze_anderson_db(double fresnel_number);

}  // namespace earshot
