// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <array>
#include <complex>
#include <filesystem>
#include <glm/vec3.hpp>
#include <limits>
#include <memory>
#include <span>
#include <string>
#include <vector>

namespace earshot {

struct HeadGrid;
struct SofaResponses;

/// Head-related transfer functions on a grid of directions, as spectra ready for synthesis.  Immutable.
/// Directions are in head axes: x right, y up, -z front.  A source near the head is heard as such, by a rigid sphere of the size of ours
/// (near_head.h).  Of a head that was measured at several distances, a source between two of them is interpolated, linearly in the
/// reciprocal of the distance; one beyond the farthest has that one, one within the nearest that one and the rigid sphere.
/// measured_spheres.h says what counts as a distance.
class Hrtf {
 public:
  /// Rigid sphere of radius 8.75 cm with ears at +-100 degrees (Duda and Martens 1998), computed, without a file.
  static std::shared_ptr<const Hrtf> rigid_sphere(float sample_rate_hz);
  /// Any SOFA file (libmysofa), resampled.  Throws InputError naming the file and the missing field.
  static std::shared_ptr<const Hrtf> from_sofa(const std::filesystem::path& path, float sample_rate_hz);
  /// The same from responses in memory; where: how messages name them.  Throws InputError too for a set whose spectra would take more than
  /// 4 GB or some minutes.
  static std::shared_ptr<const Hrtf> from_responses(const SofaResponses& responses, float sample_rate_hz, const std::string& where);

  [[nodiscard]] float sample_rate_hz() const { return sample_rate_hz_; }
  [[nodiscard]] int fft_size() const { return fft_size_; }  ///< spectra hold fft_size / 2 + 1 bins
  /// Writes the left and right spectra for `direction` (unit, head axes), interpolated: pressure at the ear over the pressure that the
  /// head's centre would have without the head.  The common delay of `lead_samples` keeps both ears causal; extra_delay_samples (>= -lead)
  /// adds to it.  distance_m: of the source from the head's centre, 0 and more.  Continuous in direction and distance.  About 1 us at 16
  /// kHz for the sphere, 4 us within 3 m; no allocation.
  void spectra(glm::vec3 direction, std::span<std::complex<float>> left, std::span<std::complex<float>> right,
               double extra_delay_samples = 0, double distance_m = std::numeric_limits<double>::infinity()) const;
  /// The same with the first arrival of each ear at time zero, and returns when that is, in samples after the head's centre, [left, right]:
  /// between two directions delays and these spectra may be interpolated, whole spectra would comb.
  std::array<double, 2> aligned_spectra(glm::vec3 direction, std::span<std::complex<float>> left, std::span<std::complex<float>> right,
                                        double distance_m = std::numeric_limits<double>::infinity()) const;
  [[nodiscard]] int lead_samples() const { return lead_samples_; }
  /// Length of the decoder filters in samples, lead included.
  [[nodiscard]] int decoder_taps() const { return decoder_taps_; }
  /// Decoder of a first-order late field: for each of the 4 N3D channels (ACN, head axes as in ambisonics.h) and each ear a
  /// spectrum [fft_size / 2 + 1], with the diffuse-field covariance of this head imposed per frequency (Zaunschirm et al. 2018).
  [[nodiscard]] std::span<const std::complex<float>> diffuse_decoder(int channel, int ear) const;

 private:
  struct Spheres;
  /// The nearest first, of one size of spectra.
  Hrtf(float sample_rate_hz, std::vector<HeadGrid> spheres);
  static void check_rate(float sample_rate_hz);
  float sample_rate_hz_ = 0;
  int fft_size_ = 0, lead_samples_ = 0, decoder_taps_ = 0;
  std::shared_ptr<const Spheres> spheres_;
  std::array<std::vector<std::complex<float>>, 8> decoder_;  ///< [channel * 2 + ear]
};

}  // namespace earshot
