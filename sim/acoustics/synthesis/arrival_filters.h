// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <complex>
#include <memory>
#include <span>
#include <vector>

#include "sim/acoustics/core/arrival.h"
#include "sim/acoustics/synthesis/arrival_spectrum.h"
#include "sim/acoustics/synthesis/rir_synthesis.h"
#include "sim/audio/head/listener_orientation.h"
#include "sim/audio/transforms/fft.h"

namespace earshot {

/// An arrival as each channel receives it, taken apart into a delay and a short filter about it: what RirSynthesizer adds to a response,
/// before the delay is rounded to samples.  Delays and filters of two poses may be interpolated, responses may not: they would comb.
/// Owns scratch: one per thread.
class ArrivalFilters {
 public:
  explicit ArrivalFilters(std::shared_ptr<const SynthesisTables> tables);
  [[nodiscard]] int num_channels() const;
  [[nodiscard]] int num_taps() const;  ///< a power of two

  /// Of the arrivals that follow (ArrivalSpectrum).
  void set_air(const AirLoss& air) { bands_.set_air(air); }
  /// delay_samples: [num_channels], of time zero.  taps: [num_channels, num_taps], time zero at tap num_taps / 2.  False, and nothing
  /// written, if no band of the arrival sounds.  About 10 us for two ears at 16 kHz; no allocation.
  bool make(const Arrival& arrival, const ListenerOrientation& orientation, float speed_of_sound_m_per_s, std::span<double> delay_samples,
            std::span<float> taps);

 private:
  void write_taps(std::size_t channel, float factor, std::span<float> taps);
  void to_ears(const Arrival& arrival, const ListenerOrientation& orientation, std::span<double> delay_samples, std::span<float> taps);
  void to_harmonics(const Arrival& arrival, const ListenerOrientation& orientation, std::span<float> taps);
  void to_microphones(const Arrival& arrival, const ListenerOrientation& orientation, double samples_per_m, std::span<double> delay_samples,
                      std::span<float> taps);

  std::shared_ptr<const SynthesisTables> tables_;
  RealFft fft_;
  ArrivalSpectrum bands_;
  std::array<std::vector<std::complex<float>>, 2> spectrum_;
  std::vector<float> response_, harmonics_;
  std::vector<std::vector<std::complex<float>>> low_pass_spectrum_;  ///< of the microphones; empty where there is none
};

}  // namespace earshot
