// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <complex>
#include <limits>
#include <span>
#include <vector>

namespace earshot {

inline constexpr double kHeadRadiusM = 0.0875;
inline constexpr double kHeadSpeedOfSoundMPerS = 343.0;

/// Pressure on a rigid sphere in the field of a point source, over the free-field pressure at its centre, time factor exp(+i w t).
/// ka: wave number times radius, >= 0.  incidence_rad[i]: angle between the direction of the source and the point on the sphere;
/// pressure[i] is written.  radii: distance of the source from the centre over the radius, > 1; infinite for a plane wave.
/// Exact series (Duda and Martens 1998, eq. 1), truncated below 1e-12.
void rigid_sphere_pressure(double ka, std::span<const double> incidence_rad, std::span<std::complex<double>> pressure,
                           double radii = std::numeric_limits<double>::infinity());

/// Delay of the first wave front at the point, relative to the centre: straight on the lit side, creeping along the sphere in the shadow
/// (Woodworth 1938), in units of radius / c.  radii: as above, >= 1.
double rigid_sphere_delay(double incidence_rad, double radii = std::numeric_limits<double>::infinity());

}  // namespace earshot
