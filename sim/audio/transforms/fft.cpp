// SPDX-License-Identifier: Apache-2.0
#include "sim/audio/transforms/fft.h"

#include <algorithm>
#include <bit>
#include <cmath>
#include <cstddef>
#include <numbers>
#include <vector>

#include "sim/audio/transforms/fft_transform.h"
#include "sim/audio/transforms/spectrum_math.h"
#include "sim/base/errors.h"

namespace earshot {
namespace {

using Complex = std::complex<float>;

/// The largest transform of fft_transform.h: libavutil 57 has none beyond 2^17 complex points (asking for one does not return).
constexpr int kMaxDirectSize = 1 << 17;
constexpr int kMaxSize = 1 << 24;

/// exp(-2 pi i k / size), each entry from its own sine and cosine: no drift.
std::vector<Complex> unit_roots(int size, int count) {
  std::vector<Complex> roots(count);
  for (int k = 0; k < count; ++k) roots[k] = Complex(std::polar(1.0, -2.0 * std::numbers::pi * k / size));
  return roots;
}

/// Forward complex transform of rows * columns points by the four-step method (Bailey 1990, "FFTs in external or hierarchical memory"):
/// columns, twiddle, rows, transpose.  In place on `data`.
class FourStepFft {
 public:
  explicit FourStepFft(int size)
      : columns_(1 << (std::bit_width(static_cast<unsigned>(size)) / 2)),
        rows_(size / columns_),
        roots_(unit_roots(size, size)),
        row_transform_(TransformKind::complex, false, columns_, 1.f),
        column_transform_(TransformKind::complex, false, rows_, 1.f),
        in_(std::max(rows_, columns_)),
        out_(std::max(rows_, columns_)),
        work_(size) {}

  void forward(Complex* data) {
    const auto rows = static_cast<std::size_t>(rows_), columns = static_cast<std::size_t>(columns_);
    for (std::size_t column = 0; column < columns; ++column) {
      for (std::size_t row = 0; row < rows; ++row) in_[row] = data[row * columns + column];
      column_transform_(out_.data(), in_.data());
      for (std::size_t k = 0; k < rows; ++k) work_[k * columns + column] = multiply(out_[k], roots_[k * column]);
    }
    for (std::size_t k = 0; k < rows; ++k) {
      std::copy_n(work_.data() + k * columns, columns, in_.data());
      row_transform_(out_.data(), in_.data());
      for (std::size_t j = 0; j < columns; ++j) data[k + rows * j] = out_[j];
    }
  }

 private:
  int columns_, rows_;
  std::vector<Complex> roots_;
  Transform row_transform_, column_transform_;
  AlignedBuffer<Complex> in_, out_, work_;
};

/// Real transform of any size up to kMaxDirectSize by the library itself.
class DirectRealFft {
 public:
  explicit DirectRealFft(int size)
      : forward_(TransformKind::real, false, size, 1.f),
        inverse_(TransformKind::real, true, size, 1.f / static_cast<float>(size)),
        time_(size),
        spectrum_(size / 2 + 1) {}

  void forward(std::span<const float> time, std::span<Complex> spectrum) {
    std::fill(std::copy(time.begin(), time.end(), time_.data()), time_.data() + time_.size(), 0.f);
    forward_(spectrum_.data(), time_.data());
    std::copy_n(spectrum_.data(), spectrum_.size(), spectrum.begin());
    // libavutil does not write the imaginary part of the last bin, so it may hold a value of an earlier inverse transform.
    spectrum[0].imag(0.f);
    spectrum[spectrum_.size() - 1].imag(0.f);
  }
  void inverse(std::span<const Complex> spectrum, std::span<float> time) {
    std::copy_n(spectrum.begin(), spectrum_.size(), spectrum_.data());  // the transform may overwrite its input
    inverse_(time_.data(), spectrum_.data());
    std::copy_n(time_.data(), time_.size(), time.begin());
  }

 private:
  Transform forward_, inverse_;
  AlignedBuffer<float> time_;
  AlignedBuffer<Complex> spectrum_;
};

/// Real transform of a large size: even samples as real and odd ones as imaginary part of a complex transform of half the size.
class PackedRealFft {
 public:
  explicit PackedRealFft(int size)
      : half_(static_cast<std::size_t>(size) / 2), complex_(size / 2), roots_(unit_roots(size, size / 2 + 1)), z_(half_) {}

  void forward(std::span<const float> time, std::span<Complex> spectrum) {
    const auto sample = [&](std::size_t i) { return i < time.size() ? time[i] : 0.f; };
    for (std::size_t i = 0; i < half_; ++i) z_[i] = {sample(2 * i), sample(2 * i + 1)};
    complex_.forward(z_.data());
    for (std::size_t k = 0; k <= half_; ++k) {
      const Complex a = z_[k % half_], b = std::conj(z_[(half_ - k) % half_]);
      const Complex even = 0.5f * (a + b), odd = multiply(0.5f * (a - b), {0.f, -1.f});
      spectrum[k] = even + multiply(roots_[k], odd);
    }
  }
  void inverse(std::span<const Complex> spectrum, std::span<float> time) {
    for (std::size_t k = 0; k < half_; ++k) {
      // As in the direct transform, only the real parts of the first and the last bin count.
      Complex a = spectrum[k], b = std::conj(spectrum[half_ - k]);
      if (k == 0) a = a.real(), b = b.real();
      const Complex even = 0.5f * (a + b), odd = multiply(0.5f * (a - b), std::conj(roots_[k]));
      z_[k] = std::conj(even + multiply({0.f, 1.f}, odd));  // inverse transform = conjugate of the forward one of the conjugate
    }
    complex_.forward(z_.data());
    const float scale = 1.f / static_cast<float>(half_);
    for (std::size_t i = 0; i < half_; ++i) {
      time[2 * i] = z_[i].real() * scale;
      time[2 * i + 1] = -z_[i].imag() * scale;
    }
  }

 private:
  std::size_t half_;
  FourStepFft complex_;
  std::vector<Complex> roots_;
  AlignedBuffer<Complex> z_;
};

}  // namespace

struct RealFft::Impl {
  explicit Impl(int num_samples) : size(num_samples) {
    if (size <= kMaxDirectSize)
      direct = std::make_unique<DirectRealFft>(size);
    else
      packed = std::make_unique<PackedRealFft>(size);
  }
  int size;
  std::unique_ptr<DirectRealFft> direct;
  std::unique_ptr<PackedRealFft> packed;
};

RealFft::RealFft(int size) {
  require(size >= 4 && size <= kMaxSize && std::has_single_bit(static_cast<unsigned>(size)), "fft size", size,
          "must be a power of two in [4, 2^24]");
  impl_ = std::make_unique<Impl>(size);
}
RealFft::~RealFft() = default;
RealFft::RealFft(RealFft&&) noexcept = default;
RealFft& RealFft::operator=(RealFft&&) noexcept = default;

int RealFft::size() const { return impl_->size; }
int RealFft::num_bins() const { return impl_->size / 2 + 1; }

void RealFft::forward(std::span<const float> time, std::span<std::complex<float>> spectrum) {
  EARSHOT_EXPECT(time.size() <= static_cast<std::size_t>(size()) && spectrum.size() >= static_cast<std::size_t>(num_bins()));
  if (impl_->direct)
    impl_->direct->forward(time, spectrum);
  else
    impl_->packed->forward(time, spectrum);
}

void RealFft::inverse(std::span<const std::complex<float>> spectrum, std::span<float> time) {
  EARSHOT_EXPECT(time.size() >= static_cast<std::size_t>(size()) && spectrum.size() >= static_cast<std::size_t>(num_bins()));
  if (impl_->direct)
    impl_->direct->inverse(spectrum, time);
  else
    impl_->packed->inverse(spectrum, time);
}

int next_power_of_two(int n) { return n <= 1 ? 1 : static_cast<int>(std::bit_ceil(static_cast<unsigned>(n))); }

}  // namespace earshot
