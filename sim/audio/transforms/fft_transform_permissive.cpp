// SPDX-License-Identifier: Apache-2.0
#include <cmath>
#include <complex>
#include <memory>
#include <numbers>
#include <utility>

#include "sim/audio/transforms/fft_transform.h"

namespace earshot {
namespace {

using Index = std::size_t;

/// Forward transforms by radix-4 steps that sort as they go (Stockham; Van Loan 1992, "Computational frameworks for the fast Fourier
/// transform", section 1.7).  Real and imaginary parts lie in arrays of their own in between, so that the loops are of plain vectors.
/// A step takes `size` = 4 m points for each of `stride` interleaved transforms; roots: [6][m], cosines and sines of the first three
/// powers.
struct Butterfly {
  float r[4], i[4];
};
inline Butterfly butterfly(const float (&r)[4], const float (&i)[4]) {
  const float apc_r = r[0] + r[2], apc_i = i[0] + i[2], amc_r = r[0] - r[2], amc_i = i[0] - i[2];
  const float bpd_r = r[1] + r[3], bpd_i = i[1] + i[3], bmd_r = r[1] - r[3], bmd_i = i[1] - i[3];
  return {{apc_r + bpd_r, amc_r + bmd_i, apc_r - bpd_r, amc_r - bmd_i}, {apc_i + bpd_i, amc_i - bmd_r, apc_i - bpd_i, amc_i + bmd_r}};
}

/// The first step, from pairs.  kSwap: the parts of a pair change places, which makes an inverse transform of a forward one.
template <bool kSwap>
void first_step(const float* __restrict in, float* __restrict out_r, float* __restrict out_i, const float* __restrict roots, Index m) {
  constexpr Index re = kSwap ? 1 : 0, im = kSwap ? 0 : 1;
  for (Index p = 0; p < m; ++p) {
    const float r[4] = {in[2 * p + re], in[2 * (p + m) + re], in[2 * (p + 2 * m) + re], in[2 * (p + 3 * m) + re]};
    const float i[4] = {in[2 * p + im], in[2 * (p + m) + im], in[2 * (p + 2 * m) + im], in[2 * (p + 3 * m) + im]};
    const Butterfly b = butterfly(r, i);
    out_r[4 * p] = b.r[0];
    out_i[4 * p] = b.i[0];
    for (Index k = 1; k < 4; ++k) {
      const float wr = roots[(2 * k - 2) * m + p], wi = roots[(2 * k - 1) * m + p];
      out_r[4 * p + k] = wr * b.r[k] - wi * b.i[k];
      out_i[4 * p + k] = wr * b.i[k] + wi * b.r[k];
    }
  }
}

/// A step between.  kStride: known at compile time for the short one, 0 for the others.
template <Index kStride>
void middle_step(const float* __restrict in_r, const float* __restrict in_i, float* __restrict out_r, float* __restrict out_i,
                 const float* __restrict roots, Index m, Index any_stride) {
  const Index stride = kStride > 0 ? kStride : any_stride, quarter = m * stride;
  for (Index p = 0; p < m; ++p) {
    const float w1r = roots[p], w1i = roots[m + p], w2r = roots[2 * m + p], w2i = roots[3 * m + p], w3r = roots[4 * m + p],
                w3i = roots[5 * m + p];
    const float *xr = in_r + p * stride, *xi = in_i + p * stride;
    float *yr = out_r + 4 * p * stride, *yi = out_i + 4 * p * stride;
#pragma GCC ivdep  // the four parts of a row are apart by `stride`, at least the width of a vector
    for (Index q = 0; q < stride; ++q) {
      const float r[4] = {xr[q], xr[q + quarter], xr[q + 2 * quarter], xr[q + 3 * quarter]};
      const float i[4] = {xi[q], xi[q + quarter], xi[q + 2 * quarter], xi[q + 3 * quarter]};
      const Butterfly b = butterfly(r, i);
      yr[q] = b.r[0];
      yi[q] = b.i[0];
      yr[q + stride] = w1r * b.r[1] - w1i * b.i[1];
      yi[q + stride] = w1r * b.i[1] + w1i * b.r[1];
      yr[q + 2 * stride] = w2r * b.r[2] - w2i * b.i[2];
      yi[q + 2 * stride] = w2r * b.i[2] + w2i * b.r[2];
      yr[q + 3 * stride] = w3r * b.r[3] - w3i * b.i[3];
      yi[q + 3 * stride] = w3r * b.i[3] + w3i * b.r[3];
    }
  }
}

/// The last step has no roots.  kRadix: 4, or 2 for odd powers of two.  Calls put(index, real, imaginary).
template <int kRadix, class Put>
inline void last_step(const float* __restrict in_r, const float* __restrict in_i, Index stride, Put put) {
#pragma GCC ivdep
  for (Index q = 0; q < stride; ++q) {
    if constexpr (kRadix == 4) {
      const float r[4] = {in_r[q], in_r[q + stride], in_r[q + 2 * stride], in_r[q + 3 * stride]};
      const float i[4] = {in_i[q], in_i[q + stride], in_i[q + 2 * stride], in_i[q + 3 * stride]};
      const Butterfly b = butterfly(r, i);
      for (Index k = 0; k < 4; ++k) put(q + k * stride, b.r[k], b.i[k]);
    } else {
      put(q, in_r[q] + in_r[q + stride], in_i[q] + in_i[q + stride]);
      put(q + stride, in_r[q] - in_r[q + stride], in_i[q] - in_i[q + stride]);
    }
  }
}
template <bool kSwap, int kRadix>
void last_to_pairs(const float* __restrict in_r, const float* __restrict in_i, float* __restrict out, Index stride) {
  last_step<kRadix>(in_r, in_i, stride, [out](Index index, float re, float im) {
    out[2 * index] = kSwap ? im : re;
    out[2 * index + 1] = kSwap ? re : im;
  });
}
template <int kRadix>
void last_to_parts(const float* __restrict in_r, const float* __restrict in_i, float* __restrict out_r, float* __restrict out_i,
                   Index stride) {
  last_step<kRadix>(in_r, in_i, stride, [=](Index index, float re, float im) {
    out_r[index] = re;
    out_i[index] = im;
  });
}

/// Complex transforms of a power of two of points, from pairs.
class ComplexSteps {
 public:
  explicit ComplexSteps(Index size) : size_(size), roots_(2 * size + 8), a_(2 * row()), b_(2 * row()) {
    float* next = roots_.data();
    for (Index n = size; n > 4; n /= 4)
      for (int power = 1; power < 4; ++power) {
        for (Index p = 0; p < n / 4; ++p) {
          const std::complex<double> root =
              std::polar(1.0, -2 * std::numbers::pi * power * static_cast<double>(p) / static_cast<double>(n));
          next[p] = static_cast<float>(root.real());
          next[n / 4 + p] = static_cast<float>(root.imag());
        }
        next += 2 * (n / 4);
      }
  }

  template <bool kSwap>
  void to_pairs(const float* in, float* out) {
    if (size_ < 8) return transform_small<kSwap>(in, [out](Index index, float re, float im) { put_pair<kSwap>(out, index, re, im); });
    const Index stride = all_but_last<kSwap>(in);
    if (size_ == 4 * stride)
      last_to_pairs<kSwap, 4>(a_.data(), a_.data() + row(), out, stride);
    else
      last_to_pairs<kSwap, 2>(a_.data(), a_.data() + row(), out, stride);
  }
  /// Parts in arrays of their own, each [size + 1]: the first value once more at the end.
  void to_parts(const float* in) {
    const Index stride = size_ < 8 ? 0 : all_but_last<false>(in);  // which of the two arrays is free is known after it
    float *re = b_.data(), *im = re + row();
    if (stride == 0)
      transform_small<false>(in, [=](Index index, float r, float i) { re[index] = r, im[index] = i; });
    else if (size_ == 4 * stride)
      last_to_parts<4>(a_.data(), a_.data() + row(), re, im, stride);
    else
      last_to_parts<2>(a_.data(), a_.data() + row(), re, im, stride);
    re[size_] = re[0];
    im[size_] = im[0];
  }
  [[nodiscard]] const float* real_parts() { return b_.data(); }  ///< of the last to_parts
  [[nodiscard]] const float* imaginary_parts() { return b_.data() + row(); }

 private:
  /// Of one array of parts: with place for one more value, and whole lines of cache.
  [[nodiscard]] Index row() const { return (size_ + 1 + 15) / 16 * 16; }

  template <bool kSwap>
  static void put_pair(float* out, Index index, float re, float im) {
    out[2 * index] = kSwap ? im : re;
    out[2 * index + 1] = kSwap ? re : im;
  }
  /// Up to four points, whose roots are exact.
  template <bool kSwap, class Put>
  void transform_small(const float* in, Put put) const {
    constexpr float cosine[4] = {1, 0, -1, 0}, sine[4] = {0, -1, 0, 1};
    float re[4] = {}, im[4] = {};
    for (Index k = 0; k < size_; ++k)
      for (Index n = 0; n < size_; ++n) {
        const Index quarter_turns = k * n * (4 / size_) % 4;
        const float r = in[2 * n + (kSwap ? 1 : 0)], i = in[2 * n + (kSwap ? 0 : 1)];
        re[k] += r * cosine[quarter_turns] - i * sine[quarter_turns];
        im[k] += r * sine[quarter_turns] + i * cosine[quarter_turns];
      }
    for (Index k = 0; k < size_; ++k) put(k, re[k], im[k]);
  }
  /// Leaves its result in a_; returns the stride of the last step.
  template <bool kSwap>
  Index all_but_last(const float* in) {
    const float* roots = roots_.data();
    float *from = a_.data(), *to = b_.data();
    Index n = size_ / 4, stride = 4;
    first_step<kSwap>(in, from, from + row(), roots, n);
    roots += 6 * n;
    for (; n > 4; n /= 4, stride *= 4) {
      const Index m = n / 4;
      if (stride == 4)
        middle_step<4>(from, from + row(), to, to + row(), roots, m, 4);
      else
        middle_step<0>(from, from + row(), to, to + row(), roots, m, stride);
      roots += 6 * m;
      std::swap(from, to);
    }
    if (from != a_.data()) std::swap(a_, b_);
    return stride;
  }

  Index size_;
  AlignedBuffer<float> roots_, a_, b_;
};

/// Spectrum of real samples from that of pairs of them: even + root * odd, over half of the points (Press et al. 2007, "Numerical
/// recipes", section 12.3).
void untangle(const float* __restrict re, const float* __restrict im, const float* __restrict roots, float scale, Index half,
              float* __restrict out) {
  const float *cosine = roots, *sine = roots + half + 1, *re_end = re + half, *im_end = im + half;
  const float factor = 0.5f * scale;
  for (Index k = 0; k <= half; ++k) {
    const float sum_r = re[k] + *(re_end - k), sum_i = im[k] - *(im_end - k);
    const float difference_r = re[k] - *(re_end - k), difference_i = im[k] + *(im_end - k);
    out[2 * k] = factor * (sum_r + (cosine[k] * difference_i + sine[k] * difference_r));
    out[2 * k + 1] = factor * (sum_i + (sine[k] * difference_i - cosine[k] * difference_r));
  }
}

/// The way back, to pairs whose inverse transform is the samples.  re, im: scratch [half + 1].
void tangle(const float* __restrict in, const float* __restrict roots, float scale, Index half, float* __restrict re, float* __restrict im,
            float* __restrict out) {
  for (Index k = 0; k <= half; ++k) {
    re[k] = in[2 * k];
    im[k] = in[2 * k + 1];
  }
  im[0] = im[half] = 0;  // they have no meaning
  const float *cosine = roots, *sine = roots + half + 1, *re_end = re + half, *im_end = im + half;
  for (Index k = 0; k < half; ++k) {
    const float sum_r = re[k] + *(re_end - k), sum_i = im[k] - *(im_end - k);
    const float difference_r = re[k] - *(re_end - k), difference_i = im[k] + *(im_end - k);
    out[2 * k] = scale * (sum_r - (difference_i * cosine[k] - difference_r * sine[k]));
    out[2 * k + 1] = scale * (sum_i + (difference_r * cosine[k] + difference_i * sine[k]));
  }
}

}  // namespace

struct Transform::Impl {
  Impl(TransformKind transform_kind, bool backward, Index num_points, float factor)
      : kind(transform_kind),
        inverse(backward),
        half(num_points / 2),
        scale(factor),
        steps(transform_kind == TransformKind::complex ? num_points : half),
        roots(transform_kind == TransformKind::real ? 2 * (half + 1) : 0),
        pairs(transform_kind == TransformKind::real && backward ? num_points : 0),
        parts(transform_kind == TransformKind::real && backward ? 2 * (half + 1) : 0) {
    for (Index k = 0; kind == TransformKind::real && k <= half; ++k) {
      const std::complex<double> root = std::polar(1.0, -std::numbers::pi * static_cast<double>(k) / static_cast<double>(half));
      roots[k] = static_cast<float>(root.real());
      roots[half + 1 + k] = static_cast<float>(root.imag());
    }
  }
  void run(float* out, const float* in) {
    if (kind == TransformKind::complex) {
      if (inverse)
        steps.to_pairs<true>(in, out);
      else
        steps.to_pairs<false>(in, out);
    } else if (inverse) {
      tangle(in, roots.data(), scale, half, parts.data(), parts.data() + half + 1, pairs.data());
      steps.to_pairs<true>(pairs.data(), out);
    } else {
      steps.to_parts(in);
      untangle(steps.real_parts(), steps.imaginary_parts(), roots.data(), scale, half, out);
    }
  }

  TransformKind kind;
  bool inverse;
  Index half;
  float scale;
  ComplexSteps steps;
  AlignedBuffer<float> roots, pairs, parts;
};

Transform::Transform(TransformKind kind, bool inverse, int size, float scale)
    : impl_(std::make_unique<Impl>(kind, inverse, static_cast<Index>(size), scale)) {}
Transform::~Transform() = default;
Transform::Transform(Transform&&) noexcept = default;
Transform& Transform::operator=(Transform&&) noexcept = default;

void Transform::operator()(void* out, void* in) const { impl_->run(static_cast<float*>(out), static_cast<const float*>(in)); }

}  // namespace earshot
