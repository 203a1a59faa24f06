// SPDX-License-Identifier: Apache-2.0
extern "C" {
#include <libavutil/tx.h>
}

#include <complex>
#include <memory>

#include "sim/audio/transforms/fft_transform.h"
#include "sim/base/errors.h"

namespace earshot {

struct Transform::Impl {
  struct Release {
    void operator()(AVTXContext* context) const noexcept { av_tx_uninit(&context); }
  };
  std::unique_ptr<AVTXContext, Release> context;
  av_tx_fn run = nullptr;
  std::ptrdiff_t stride = 0;
};

Transform::Transform(TransformKind kind, bool inverse, int size, float scale) : impl_(std::make_unique<Impl>()) {
  const bool complex = kind == TransformKind::complex;
  AVTXContext* raw = nullptr;
  const int status =
      av_tx_init(&raw, &impl_->run, complex ? AV_TX_FLOAT_FFT : AV_TX_FLOAT_RDFT, inverse ? 1 : 0, size, complex ? nullptr : &scale, 0);
  impl_->context.reset(raw);
  if (status < 0) throw RunError("libavutil", "av_tx_init refused a transform size");
  impl_->stride = complex || inverse ? sizeof(std::complex<float>) : sizeof(float);
}
Transform::~Transform() = default;
Transform::Transform(Transform&&) noexcept = default;
Transform& Transform::operator=(Transform&&) noexcept = default;

void Transform::operator()(void* out, void* in) const { impl_->run(impl_->context.get(), out, in, impl_->stride); }

}  // namespace earshot
