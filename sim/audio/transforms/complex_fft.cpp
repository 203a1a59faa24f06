// SPDX-License-Identifier: Apache-2.0
#include "sim/audio/transforms/complex_fft.h"

#include <algorithm>
#include <bit>
#include <cstdint>

#include "sim/audio/transforms/fft_transform.h"
#include "sim/base/errors.h"

namespace earshot {
namespace {

using Complex = std::complex<float>;

void interleave(std::size_t count, const float* a, const float* b, Complex* __restrict pairs) {
  for (std::size_t i = 0; i < count; ++i) pairs[i] = {a[i], b[i]};
}

}  // namespace

struct ComplexFft::Impl {
  Impl(int num_points, bool inverse)
      : size(static_cast<std::size_t>(num_points)), run(TransformKind::complex, inverse, num_points, 1.f), in(size), out(size) {}
  std::size_t size;
  Transform run;
  AlignedSpectrum in, out;
};

ComplexFft::ComplexFft(int size, Direction direction) {
  require(size >= 16 && size <= 1 << 17 && std::has_single_bit(static_cast<unsigned>(size)), "fft size", size,
          "must be a power of two in [16, 2^17]");
  impl_ = std::make_unique<Impl>(size, direction == Direction::inverse);
}
ComplexFft::~ComplexFft() = default;
ComplexFft::ComplexFft(ComplexFft&&) noexcept = default;
ComplexFft& ComplexFft::operator=(ComplexFft&&) noexcept = default;

int ComplexFft::size() const { return static_cast<int>(impl_->size); }
std::span<Complex> ComplexFft::input() { return impl_->in; }

void ComplexFft::set_input(std::span<const float> real, std::span<const float> imaginary) {
  EARSHOT_EXPECT(real.size() <= impl_->size && (imaginary.empty() || imaginary.size() == real.size()));
  Complex* in = impl_->in.data();
  if (imaginary.empty())
    std::transform(real.begin(), real.end(), in, [](float value) { return Complex(value); });
  else
    interleave(real.size(), real.data(), imaginary.data(), in);
  std::fill(in + real.size(), in + impl_->size, Complex{});
}

std::span<const Complex> ComplexFft::transform() {
  transform(impl_->out);
  return impl_->out;
}

void ComplexFft::transform(std::span<Complex> output) {
  EARSHOT_EXPECT(output.size() >= impl_->size && reinterpret_cast<std::uintptr_t>(output.data()) % 64 == 0);
  impl_->run(output.data(), impl_->in.data());
}

}  // namespace earshot
