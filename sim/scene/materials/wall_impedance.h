// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <complex>

namespace earshot {

/// Locally reacting walls: reflection by a specific impedance z, the surface's over that of air, alike for every angle (Kuttruff, Room
/// Acoustics, 5th ed., section 2.3).  Convention exp(+j w t): a stiffness has a negative imaginary part.

/// Pressure reflection of a plane wave at an angle of incidence with this cosine, in [0, 1]: (z cos - 1) / (z cos + 1), eq. 2.17.  -1 at
/// grazing incidence for any finite z.  Real part of z >= 0.
std::complex<double> wall_reflection(std::complex<double> impedance, double cosine);

/// Absorption at random incidence: Paris' integral of 1 - |R|^2 over all angles in closed form (Paris 1928; Kuttruff eq. 2.42).  0 for a
/// real part of 0, at most 0.9512.  Relative error below 1e-6.
double random_incidence_absorption(std::complex<double> impedance);

/// Largest absorption at random incidence of any locally reacting wall, at z = 1.5669.
inline constexpr double kLargestLocalAbsorption = 0.9512221;

/// The real impedance with this absorption at random incidence, the harder one of two: in [1.567, 1e6].  An absorption above
/// kLargestLocalAbsorption has that of the largest.  By bisection, 1e-9 relative.
double impedance_of_absorption(double absorption);

}  // namespace earshot
