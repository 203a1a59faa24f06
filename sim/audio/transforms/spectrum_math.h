// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cmath>
#include <complex>
#include <numbers>
#include <span>

namespace earshot {

/// a * b without the NaN checks of std::complex, which keep loops from being vectorized.
inline std::complex<float> multiply(std::complex<float> a, std::complex<float> b) {
  return {a.real() * b.real() - a.imag() * b.imag(), a.real() * b.imag() + a.imag() * b.real()};
}

/// sum[k] += a[k] * b[k]
inline void multiply_add(std::span<const std::complex<float>> a, std::span<const std::complex<float>> b,
                         std::span<std::complex<float>> sum) {
  const std::complex<float>*x = a.data(), *y = b.data();
  std::complex<float>* z = sum.data();
  for (std::size_t k = 0; k < sum.size(); ++k)
    z[k] = {z[k].real() + (x[k].real() * y[k].real() - x[k].imag() * y[k].imag()),
            z[k].imag() + (x[k].real() * y[k].imag() + x[k].imag() * y[k].real())};
}

/// Delays a signal by multiplying its spectrum [fft_size / 2 + 1] by exp(-2 pi i k delay / fft_size).  Negative delays advance.
inline void delay_spectrum(std::span<std::complex<float>> spectrum, double delay_samples, int fft_size) {
  constexpr std::size_t block = 16;
  const double step = -2.0 * std::numbers::pi * delay_samples / fft_size;
  // By multiplication in double: no drift that a float could hold.
  const std::complex<double> one_step = std::polar(1.0, step);
  std::complex<float> within[block];
  std::complex<double> turn = 1.0;
  for (std::complex<float>& value : within) {
    value = std::complex<float>(turn);
    turn = {turn.real() * one_step.real() - turn.imag() * one_step.imag(), turn.real() * one_step.imag() + turn.imag() * one_step.real()};
  }
  const std::complex<double> block_step = std::polar(1.0, step * static_cast<double>(block));
  std::complex<double> start = 1.0;
  for (std::size_t k = 0; k < spectrum.size(); k += block) {
    const std::complex<float> base(start);
    const std::size_t count = std::min(block, spectrum.size() - k);
    std::complex<float>* values = spectrum.data() + k;
    for (std::size_t i = 0; i < count; ++i) values[i] = multiply(values[i], multiply(base, within[i]));
    start = {start.real() * block_step.real() - start.imag() * block_step.imag(),
             start.real() * block_step.imag() + start.imag() * block_step.real()};
  }
}

}  // namespace earshot
