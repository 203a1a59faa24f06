// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <array>
#include <complex>
#include <cstddef>
#include <glm/vec3.hpp>
#include <limits>
#include <span>
#include <vector>

namespace earshot {

/// Number of points by which means over all directions are taken.
inline constexpr int kMeanDirections = 500;
/// Of them: evenly spread over the sphere, unit, head axes.
glm::vec3 mean_direction(int number);

/// cosine of the angle between a unit direction and that of an ear (0: left, 1: right) of the rigid sphere.
double cosine_at_ear(glm::dvec3 towards, int ear);

/// Spectra of the two ears on a grid of directions, for sources at one distance: with the first arrival moved to time zero, and its delay
/// beside them.  Delays and aligned spectra may be interpolated linearly, spectra as measured may not (they would comb).
struct HeadGrid {
  int fft_size = 0;
  std::size_t num_bins = 0;
  double distance_m = std::numeric_limits<double>::infinity();
  int intervals = 0;                         ///< sphere: rows are incidence angles, pi / intervals apart; 0 for a measured head, whose
                                             ///< rows are [node][ear] (NodeGrid)
  std::vector<std::complex<float>> aligned;  ///< [row][num_bins]
  std::vector<double> delay_samples;         ///< [row], relative to the head's centre

  /// Writes `fraction` of both aligned spectra and of their delays, [left, right], or adds it to what is there.
  void write_aligned(glm::vec3 towards, float fraction, bool add, std::array<double, 2>& delay, std::span<std::complex<float>> left,
                     std::span<std::complex<float>> right) const;
  /// Spectra with their delays.
  void write(glm::vec3 towards, std::span<std::complex<float>> left, std::span<std::complex<float>> right) const;

  /// The rigid sphere of kHeadRadiusM.
  static HeadGrid rigid_sphere(float sample_rate_hz);

 private:
  static constexpr std::size_t kMaxRows = 4;
  struct Blend {
    std::size_t count = 0;
    std::array<std::size_t, kMaxRows> row{};
    std::array<float, kMaxRows> weight{};
  };
  [[nodiscard]] Blend blend_sphere(glm::dvec3 towards, int ear) const;
  [[nodiscard]] static Blend blend_nodes(glm::dvec3 towards);
  double write_rows(const Blend& blend, float fraction, bool add, double delay, std::span<std::complex<float>> out) const;
};

/// Samples before time zero: the near ear is early by radius / c = 0.26 ms, and filters of limited band ring before they start.
int lead_for(float sample_rate_hz);
/// Bins of a head: 20 ms.
int smallest_fft_for(float sample_rate_hz);

}  // namespace earshot
