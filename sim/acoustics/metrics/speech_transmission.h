// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <array>
#include <optional>
#include <span>

namespace earshot {

/// Modulation frequencies of IEC 60268-16.
inline constexpr std::array<double, 14> kModulationHz{0.63, 0.8, 1, 1.25, 1.6, 2, 2.5, 3.15, 4, 5, 6.3, 8, 10, 12.5};
inline constexpr std::size_t kSpeechOctaves = 7;  ///< 125 Hz to 8 kHz

/// Fraction of the modulation of a source that a response lets through: size of the Fourier transform of its energy over the energy
/// (Schroeder 1981, "Modulation transfer functions", Acustica 49).  energy: bins of bin_s from time zero on, each spread evenly;
/// direct_energy at time zero.  0 for a silent response.
double modulation_transfer(std::span<const double> energy, double bin_s, double direct_energy, double modulation_hz);

/// Mean over modulation frequencies of the transmission indices of one octave, in [0, 1] (IEC 60268-16:2020, clause A.5): modulation,
/// reduced by noise at snr_db below the speech (infinity: none), as an apparent ratio of signal to noise from -15 to 15 dB.  nullopt for
/// a silent response.
std::optional<double> modulation_transfer_index(std::span<const double> energy, double bin_s, double direct_energy, double snr_db);

/// Index of the band of each octave from 125 Hz to 8 kHz in a layout of octaves; nullopt where one is missing or bands are no octaves.
std::optional<std::array<std::size_t, kSpeechOctaves>> speech_octaves(std::span<const float> bands_hz);

/// STI of the male spectrum from the indices of seven octaves: weights and redundancy factors of IEC 60268-16:2011, table A.1.  Hearing
/// threshold and masking between octaves, which need absolute levels, are left out.
double speech_transmission_index(std::span<const double, kSpeechOctaves> mti);

}  // namespace earshot
