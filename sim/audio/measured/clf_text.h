// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstddef>
#include <string>
#include <string_view>
#include <vector>

namespace earshot {

/// Balloon of a loudspeaker in the text of the Common Loudspeaker Format: arcs from its front to its back, one for each angle around its
/// axis.
struct ClfBalloon {
  std::size_t step_deg = 10;         ///< 10 of CLF1, 5 of CLF2: along arcs, and between them
  std::vector<double> frequency_hz;  ///< [F], rising
  /// [F][arc from 0 (up) to 180 degrees (down)][angle from 0 (front) to 180 degrees], on both sides; relative to any level.
  std::vector<double> level_db;
  double asymmetry = 0;  ///< of left and right: their root-mean-square difference over the pressure, both weighted by solid angle
  [[nodiscard]] std::size_t num_angles() const { return 180 / step_deg + 1; }
};

/// Reads version 1 of CLF1 and CLF2: header lines <TAG> TAB value, and for each <BAND> one row of levels in dB per arc.  Arcs begin above
/// the front.  In which direction they go round, no public description says: of balloons without symmetry the mean power of left and right
/// counts, and more than 12 % between them is refused.  Refused by name: binary files (CF1, CF2), version 2 with phases, filters and parts,
/// <BALLOON-SYMMETRY> vertical and polar, half spheres, turned arcs, <nodata>, levels that do not agree on the axis, where all arcs meet,
/// and a text without the end tag of its start tag, which is cut short.  Throws InputError naming `where`, the line and the field. O(size).
ClfBalloon parse_clf(std::string_view text, const std::string& where);

}  // namespace earshot
