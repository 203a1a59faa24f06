// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstddef>
#include <memory>
#include <span>
#include <vector>

#include "sim/audio/transforms/spectrogram.h"

namespace earshot {

/// Interaural cues for the direction and distance of a sound (Blauert 1997, sections 2.4 and 3.2; coherence as in Faller and
/// Merimaa 2004, eqs. 4 to 6).  Cells as those of the spectrogram: pool x pool bins and frames, in which powers P of the left and the right
/// ear and the cross spectrum C = sum L conj(R) are summed.  Channels of a cell:
///   0  level: 10 log10 of the mean of both powers above kInterauralFloorDb, in kInterauralLevelDb
///   1  level difference: 10 log10 of left over right, both with the floor added, in kInterauralDifferenceDb
///   2  Re C / sqrt(P_left P_right), the cosine of the phase difference times the coherence; the floor is added to both powers
///   3  Im C / sqrt(P_left P_right), its sine times the coherence; positive where the left ear leads
/// 0 dB is the power in one cell of white noise with a standard deviation of 1.  In silence all are 0.
inline constexpr int kInterauralChannels = 4;
inline constexpr float kInterauralFloorDb = -100, kInterauralLevelDb = 40, kInterauralDifferenceDb = 10;

/// Frames of the window that one listener had last, so that the next analysis does those anew that hold new samples.  Starts empty.
class InterauralHistory {
 public:
  void forget() { valid_ = false; }

 private:
  friend class InterauralAnalyzer;
  bool valid_ = false;
  std::vector<float> sums_;  ///< [frames, 4, rows]: left and right power, real and imaginary cross spectrum, summed over the bins of a row
};

/// Owns the FFT and scratch: one per thread.
class InterauralAnalyzer {
 public:
  explicit InterauralAnalyzer(const SpectrogramConfig& config);
  ~InterauralAnalyzer();
  InterauralAnalyzer(InterauralAnalyzer&&) noexcept;
  /// sound [2, num_samples] -> cells [rows, columns, 4].  new_samples: by how much the window has moved since the last call with this
  /// history; frames inside both windows are taken from there, with the same bits.  About 0.07 ms for 2,400 new samples of 16,000.
  /// Allocates in the first call for `history`.
  void analyze(std::span<const float> sound, std::size_t new_samples, InterauralHistory& history, std::span<float> cells);

 private:
  struct Impl;
  std::unique_ptr<Impl> impl_;
};

}  // namespace earshot
