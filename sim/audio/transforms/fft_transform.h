// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstddef>
#include <cstring>
#include <memory>
#include <new>

namespace earshot {

/// Memory aligned for the widest vectors, zeroed.
template <class T>
class AlignedBuffer {
 public:
  explicit AlignedBuffer(std::size_t size) : data_(static_cast<T*>(::operator new (size * sizeof(T), std::align_val_t{64}))), size_(size) {
    std::memset(static_cast<void*>(data_.get()), 0, size * sizeof(T));
  }
  [[nodiscard]] T* data() { return data_.get(); }
  [[nodiscard]] std::size_t size() const { return size_; }
  T& operator[](std::size_t i) { return data_.get()[i]; }

 private:
  struct Release {
    void operator()(T* memory) const noexcept { ::operator delete (memory, std::align_val_t{64}); }
  };
  std::unique_ptr<T, Release> data_;
  std::size_t size_;
};

enum class TransformKind { complex, real };

/// A Fourier transform of one size and direction, by the library that EARSHOT_AUDIO_LIBRARIES chooses (docs/dependencies.md): libavutil
/// (fft_transform_libav.cpp) or the code of fft_transform_permissive.cpp.  Both keep one contract; their rounding differs.
///  - complex, [size] to [size]: sum of x[n] exp(-+2 pi i k n / size), unscaled; scale is not used.
///  - real forward, [size] floats to [size / 2 + 1] complex: the same, times scale.  Imaginary parts of the first and the last bin: any.
///  - real inverse, [size / 2 + 1] complex to [size] floats: scale times the unscaled inverse, which is size times the signal.
/// size: a power of two, complex in [1, 2^17], real in [4, 2^17].  Throws RunError where the library refuses one.  Owns scratch: one per
/// thread.
class Transform {
 public:
  Transform(TransformKind kind, bool inverse, int size, float scale);
  ~Transform();
  Transform(Transform&&) noexcept;
  Transform& operator=(Transform&&) noexcept;
  /// out and in: aligned to 64 bytes, apart from each other.  The content of `in` may be lost.
  void operator()(void* out, void* in) const;

 private:
  struct Impl;
  std::unique_ptr<Impl> impl_;
};

}  // namespace earshot
