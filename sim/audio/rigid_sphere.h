#pragma once

#include <complex>
#include <span>
#include <vector>

namespace earshot {

inline constexpr double kHeadRadiusM = 0.0875;
inline constexpr double kHeadSpeedOfSoundMPerS = 343.0;

/// Pressure on a rigid sphere in a plane wave, over the free-field pressure at its centre, time factor exp(+i w t).
/// ka: wave number times radius, >= 0.  incidence_rad[i]: angle between the direction of the source and the point on the sphere;
/// pressure[i] is written.  Exact series (Duda and Martens 1998, eq. 1 for an infinite distance), truncated below 1e-12.
void rigid_sphere_pressure(double ka, std::span<const double> incidence_rad, std::span<std::complex<double>> pressure);

/// Delay of the first wave front at the point, relative to the centre: straight on the lit side, creeping along the sphere in the shadow
/// (Woodworth 1938), in units of radius / c.
double rigid_sphere_delay(double incidence_rad);

}  // namespace earshot
