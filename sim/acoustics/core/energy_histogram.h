// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstddef>
#include <span>
#include <vector>

namespace earshot {

/// Of an arrival direction, at the highest order that the tracers carry: 5.
inline constexpr int kMaxCoefficients = 36;

/// Energy arriving at the listener by (time bin, band, spherical-harmonic coefficient), Green units: a direct path of length r
/// has energy 1 / (4 pi r)^2.  Time counts from emission.  Coefficient 0 is the energy itself; the others are the energy
/// weighted by real N3D harmonics of the arrival direction (pointing from the listener toward where the sound comes from, world axes).
class EnergyHistogram {
 public:
  EnergyHistogram() = default;
  EnergyHistogram(int num_bins, int num_bands, int sh_order, float bin_s);

  [[nodiscard]] int num_bins() const { return num_bins_; }
  [[nodiscard]] int num_bands() const { return num_bands_; }
  [[nodiscard]] int num_coefficients() const { return num_coefficients_; }
  [[nodiscard]] float bin_s() const { return bin_s_; }
  /// Coefficients of one bin and band: [num_coefficients].
  [[nodiscard]] std::span<const float> at(int bin, int band) const;
  [[nodiscard]] float energy(int bin, int band) const { return at(bin, band)[0]; }
  /// Energy per bin of one band.
  [[nodiscard]] std::vector<double> band_energy(int band) const;

  /// Adds energy [num_bands] arriving at time_s, split linearly between the two nearest bin centres (keeps the mean time exact; before
  /// the first centre and after the last all goes to that bin).  Exactly on the last edge: the last bin.  Beyond it, negative or NaN:
  /// counted in dropped_energy(), never wrapped.  sh: harmonics of the arrival direction [num_coefficients], sh[0] = 1.
  void add(float time_s, std::span<const float> energy, std::span<const float> sh);
  void add(const EnergyHistogram& other);  ///< same shape
  void add_dropped(double energy) { dropped_energy_ += energy; }
  void scale(float factor);                   ///< dropped_energy() too
  void scale(std::span<const float> factor);  ///< per band: the first num_bands.  Not dropped_energy(), whose bands are not known
  /// Multiplies each bin by exp(-m_b c t): exact for air, as path length is c t (docs/explanation/effect_bounds.md, section 2).
  void attenuate(std::span<const float> energy_per_m, float speed_of_sound_m_per_s);
  void clear();  ///< keeps the shape
  [[nodiscard]] double dropped_energy() const { return dropped_energy_; }
  [[nodiscard]] std::span<float> values() { return values_; }  ///< [bin][band][coefficient]
  [[nodiscard]] std::span<const float> values() const { return values_; }

 private:
  int num_bins_ = 0, num_bands_ = 0, num_coefficients_ = 0;
  float bin_s_ = 0;
  double dropped_energy_ = 0;
  std::vector<float> values_;
};

}  // namespace earshot
