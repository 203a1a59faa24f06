// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <array>
#include <glm/vec3.hpp>
#include <span>

#include "sim/acoustics/core/boundary_weight.h"
#include "sim/acoustics/geometry/panel_edges.h"
#include "sim/acoustics/model/panel_shapes.h"
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

/// Wave that a rigid panel in the air (panel_shapes.h) sends to a listener in front of it, whether the point of reflection lies on the
/// panel or not.  It stands for the image, for what the panel sends to its sides, and for its edges' reflection: nothing of these may be
/// added.
///
/// The wave is a product of two strips, as Kirchhoff's integral is.  A strip sends the image where it is in sight, and each of its edges
/// half of it as scaled_erfc(u) by the way over the edge, u^2 = 2 k L sin^2(d / 2) as in utd.h, times two factors:
///  - that of a half plane's edge, which is exact (Sommerfeld 1896): with inward directions a, a' and heights c, c' of source and listener
///    as seen from the edge its square is 2 (1 + a)(1 + a') / (1 + c c' + a a'), which is 1 where the image ends;
///  - what the other edge leaves of it, E(v) E(v') with E(v) = 1 - exp(-j v^2) scaled_erfc(v) and v^2 = k times how much longer the way
///    over both edges is.  So the wave has the field of the sheet along itself, with the second diffraction, and vanishes in its plane. The
///    image and what continues it have the size of these alone, (1 - exp(-4 v^2 / pi))^(1/2), without their ripple.
/// Small panels: (k low_ratio)^2 of Kirchhoff's energy (panel_shapes.h), times c c' and a resonance by two constants that are fitted to the
/// exact strip, and taken over where k low_ratio is 1.3.  Faces of solids: Kirchhoff's reflection alone.
/// Source and listener swapped give the same bits.
///
/// Error (docs/evidence/validation.md): 0.8 dB of a sector of 15 degrees in an octave, root mean square, against boundary elements.
class PanelWave {
 public:
  /// Both ends in front of the panel.
  PanelWave(const PanelShape& panel, glm::dvec3 source, glm::dvec3 listener);
  /// The path that the phase is relative to: by the image, in sight or not.
  [[nodiscard]] double image_m() const { return image_m_; }
  /// Does the point of reflection lie on the panel?
  [[nodiscard]] bool in_sight() const { return in_sight_; }
  /// The point of the panel nearest to that of reflection.
  [[nodiscard]] glm::dvec3 at() const { return at_; }
  /// Energy relative to an endless panel's image, the mean of three frequencies of an octave, and phase at the centre.
  [[nodiscard]] PanelReflection::Factor factor(const WaveLanes& wave) const;

 private:
  struct Edge {
    double detour_m = 0, past_source_m = 0, past_listener_m = 0;  ///< of the way over the edge, and of that over both
    float root_of_length = 0;                                     ///< u over the root of k
    float spread = 1;                                             ///< image path over the way over the edge
    float factor = 1;                                             ///< of a half plane
    bool lit = false;
  };
  struct Strip {
    std::array<Edge, 2> edge;
    std::array<double, 2> past_m{};  ///< of the image's path, over each edge
  };
  struct Pressure {
    ComplexLanes whole, kirchhoff;
  };
  [[nodiscard]] Pressure pressure(const WaveLanes& wave) const;
  [[nodiscard]] Lanes energy(const WaveLanes& wave, const Pressure& sum) const;

  std::array<Strip, 2> strips_;
  glm::dvec3 at_{0};
  double image_m_ = 0, low_ratio_m_ = 0;
  float heights_ = 0, low_factor_ = 0;  ///< c c' at the panel; obliquity of a small panel
  bool in_sight_ = false, is_sheet_ = false;
};

/// 1 for a sheet that is small against the wave, 0 for a large one: how PanelWave goes from one to the other.
Lanes smallness_of(const PanelShape& panel, const WaveLanes& wave);

/// Energy of a sheet over Kirchhoff's: 1 if it is large against the wave, or the face of a solid.  cosine: of incidence.
double small_panel_gain(const PanelShape& panel, double wavenumber, double cosine);

/// Fraction of the energy that falls on a panel that it reflects, to all sides together: Parseval's sum of Kirchhoff's waves that are not
/// evanescent, times small_panel_gain(), at most 1.  The rest passes round it.
double reflected_fraction(const PanelShape& panel, double wavenumber, double cosine);

}  // namespace earshot
