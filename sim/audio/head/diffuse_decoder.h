// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <array>
#include <complex>
#include <functional>
#include <glm/vec3.hpp>
#include <span>
#include <vector>

namespace earshot {

/// Ear spectra of a head for one direction (head axes), without lead: [num_bins] each.
using EarSpectra = std::function<void(glm::vec3 direction, std::span<std::complex<float>> left, std::span<std::complex<float>> right)>;

/// Decoder of a first-order sound field to two ears: spectra [channel * 2 + ear][fft_size / 2 + 1] for N3D channels in ACN order. Magnitude
/// least squares (Schoerkhuber et al. 2018) above 1.5 kHz, where four channels cannot hold the phase of a head, then a 2 x 2 matrix per
/// frequency that gives the ears the covariance they have in a diffuse field (Zaunschirm et al. 2018, eqs. 12 to 17), and a cut to `taps`
/// samples of which `lead_samples` precede time zero.  Zero where the head is, as above the band of a measurement.
std::array<std::vector<std::complex<float>>, 8> make_diffuse_decoder(const EarSpectra& head, int fft_size, float sample_rate_hz,
                                                                     int lead_samples, int taps);

}  // namespace earshot
