// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <complex>
#include <memory>
#include <new>
#include <span>
#include <vector>

namespace earshot {

/// Memory aligned for the widest vectors.
template <class T>
struct VectorAllocator {
  using value_type = T;
  VectorAllocator() = default;
  template <class Other>
  VectorAllocator(const VectorAllocator<Other>&) {}
  T* allocate(std::size_t count) { return static_cast<T*>(::operator new (count * sizeof(T), std::align_val_t{64})); }
  void deallocate(T* memory, std::size_t count) noexcept { ::operator delete (memory, count * sizeof(T), std::align_val_t{64}); }
  friend bool operator==(const VectorAllocator&, const VectorAllocator&) { return true; }
};

using AlignedSpectrum = std::vector<std::complex<float>, VectorAllocator<std::complex<float>>>;

/// Complex FFT of one direction (fft_transform.h), neither scaled: the inverse of the forward transform is `size` times the signal.  Two
/// real signals fit in as real and imaginary part: a filter with real taps treats both alike.  Rounding of the louder one, 1e-7 of it,
/// then reaches the other.  Owns aligned scratch: one per thread.
class ComplexFft {
 public:
  enum class Direction { forward, inverse };
  ComplexFft(int size, Direction direction);  ///< power of two in [16, 2^17]; InputError otherwise
  ~ComplexFft();
  ComplexFft(ComplexFft&&) noexcept;
  ComplexFft& operator=(ComplexFft&&) noexcept;
  [[nodiscard]] int size() const;
  /// [size], for the caller to fill; its content is lost in a transform.
  [[nodiscard]] std::span<std::complex<float>> input();
  /// Fills the input with two real signals, zero-padded; both empty or of one size, or the second alone empty.
  void set_input(std::span<const float> real, std::span<const float> imaginary);
  /// Transform of the input: [size], until the next one.
  std::span<const std::complex<float>> transform();
  /// The same to `output`: [size], aligned to 64 bytes (AlignedSpectrum).
  void transform(std::span<std::complex<float>> output);

 private:
  struct Impl;
  std::unique_ptr<Impl> impl_;
};

}  // namespace earshot
