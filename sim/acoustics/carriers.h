#pragma once

#include <cstdint>
#include <span>
#include <vector>

#include "sim/acoustics/bands.h"

namespace earshot {

/// Band-limited noise whose short-time level does not wander (ORACLES 2.6): seeded Gaussian noise, band-filtered, divided by its own smoothed local
/// rms, filtered again, three times.  Plain noise puts 9 % rms error into an octave-band T20; this, 1.6 %.
///
/// Scale: the carrier of band b has the power that unit white noise has in that band, so that equal energies in all bands give a flat spectrum at the level of a direct
/// sound of that energy.  Carriers of different channels and bands are independent.  Each is a circle: any offset may be its start.
class CarrierBank {
 public:
  /// length: least number of samples; rounded up to a power of two, at least 16,384.  Cost: about 20 ms per channel at that size.
  CarrierBank(const BandLayout& bands, float sample_rate_hz, int length, int num_channels, std::uint64_t seed);

  [[nodiscard]] int length() const { return length_; }
  [[nodiscard]] int num_channels() const { return num_channels_; }
  /// [length], to be read circularly.
  [[nodiscard]] std::span<const float> carrier(int channel, int band) const;

 private:
  int length_, num_bands_, num_channels_;
  std::vector<float> samples_;  ///< [channel][band][length]
};

}  // namespace earshot
