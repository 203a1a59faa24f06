// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <complex>
#include <memory>
#include <span>

namespace earshot {

/// Real FFT of a power-of-two size (fft_transform.h).  Forward: X[k] = sum x[n] exp(-2 pi i k n / size), k = 0 ... size/2.  Inverse
/// includes the 1 / size, so inverse(forward(x)) == x.  Owns aligned scratch: one per thread.
class RealFft {
 public:
  explicit RealFft(int size);  ///< power of two in [4, 2^24]; InputError otherwise
  ~RealFft();
  RealFft(RealFft&&) noexcept;
  RealFft& operator=(RealFft&&) noexcept;
  [[nodiscard]] int size() const;
  [[nodiscard]] int num_bins() const;                                                  ///< size / 2 + 1
  void forward(std::span<const float> time, std::span<std::complex<float>> spectrum);  ///< time may be shorter: zero-padded
  void inverse(std::span<const std::complex<float>> spectrum, std::span<float> time);  ///< time: [size]

 private:
  struct Impl;
  std::unique_ptr<Impl> impl_;
};

/// Smallest power of two >= n.
int next_power_of_two(int n);

}  // namespace earshot
