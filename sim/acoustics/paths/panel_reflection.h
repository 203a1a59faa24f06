// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <array>
#include <glm/vec3.hpp>
#include <span>

#include "sim/acoustics/geometry/panel_edges.h"
#include "sim/acoustics/paths/band_lanes.h"

namespace earshot {

/// Reflection of a panel of finite size: the fraction of the energy of an endless one, by the Fresnel integrals of Kirchhoff's
/// approximation over its extent in two directions about the point of reflection (Rindel 1992, Acoustic reflector: J. Acoust. Soc. Am.,
/// K = K1 K2 from the distances to the edges).  As each integral is taken between exact detours over the edges, there is no far-field
/// approximation.  Edges count in full up to a detour of half a wave, not from a wave on.  In the middle of a panel it may be above 1 where
/// its edges are half a wave away (a zone plate).
class PanelReflection {
 public:
  /// image, listener: ends of the unfolded straight path through `at`, a point of the panel.  longest_wave_m: at the centre of the lowest
  /// band.
  PanelReflection(std::span<const PanelEdge> edges, glm::dvec3 image, glm::dvec3 listener, glm::dvec3 at, double longest_wave_m);
  /// Does any edge matter?  Otherwise the fraction is 1.
  [[nodiscard]] bool finite() const { return finite_; }
  /// Energy of a finite panel relative to an endless one, in [0, 4], the mean of three frequencies of an octave around `wavenumber`, and
  /// the phase at its centre; eight bands at once.
  struct Factor {
    Lanes energy, phase_rad;
  };
  [[nodiscard]] Factor factor(const Lanes& wavenumber) const;

 private:
  [[nodiscard]] ComplexLanes pressure_factor(const Lanes& wavenumber) const;

  std::array<double, 4> detour_m_;  ///< over the edges: along the first direction, against it, along the second, against it
  bool finite_ = false;
};

/// Weight of what an edge does to a path that is shorter by `waves` wavelengths: 1 to a quarter, 0 from a half on.
double boundary_weight(double waves);

}  // namespace earshot
