// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <complex>
#include <span>
#include <vector>

#include "sim/audio/measured/measured_source.h"

namespace earshot {

/// Pressure of a source by band and direction.
struct SourceBands {
  std::vector<double> centre_hz;   ///< [B], rising
  std::vector<char> has_polarity;  ///< [B]: values have a sign, that relative to the front
  std::vector<double> pressure;    ///< [B][direction]
};

/// Lines at least a quarter of an octave apart stay as they are.  Denser ones become third octaves of 1000 Hz times powers of 2: the mean
/// power of the lines of each, weighted by the frequency between them, and between two lines where a third octave has fewer.
/// A band has polarity where its pressure is in phase or in opposite phase with the front: over the directions at most a tenth of the power
/// of the lines' products with the front is out of phase, and the lines of a band agree to three quarters of their power.  Elsewhere values
/// are magnitudes: a phase that turns with the direction belongs to a source off the origin, and its sign would cut zeros into the power.
/// front: [F] pressure in front.
SourceBands bands_of(const MeasuredSource& source, std::span<const std::complex<double>> front);

}  // namespace earshot
