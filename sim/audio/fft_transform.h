#pragma once

extern "C" {
#include <libavutil/mem.h>
#include <libavutil/tx.h>
}

#include <cstddef>
#include <memory>
#include <new>

#include "sim/base/errors.h"

namespace earshot {

struct ReleaseTransform {
  void operator()(AVTXContext* context) const noexcept { av_tx_uninit(&context); }
};
struct ReleaseMemory {
  void operator()(void* memory) const noexcept { av_free(memory); }
};

/// Memory aligned for the widest vectors, zeroed.
template <class T>
class AlignedBuffer {
 public:
  explicit AlignedBuffer(std::size_t size) : data_(static_cast<T*>(av_calloc(size, sizeof(T)))), size_(size) {
    if (!data_) throw std::bad_alloc();
  }
  [[nodiscard]] T* data() { return data_.get(); }
  [[nodiscard]] std::size_t size() const { return size_; }
  T& operator[](std::size_t i) { return data_.get()[i]; }

 private:
  std::unique_ptr<T, ReleaseMemory> data_;
  std::size_t size_;
};

/// A transform of libavutil.
struct Transform {
  Transform(AVTXType type, bool inverse, int size, float scale) {
    AVTXContext* raw = nullptr;
    const int status = av_tx_init(&raw, &run, type, inverse ? 1 : 0, size, type == AV_TX_FLOAT_FFT ? nullptr : &scale, 0);
    context.reset(raw);
    if (status < 0) throw RunError("libavutil", "av_tx_init refused a transform size");
  }
  void operator()(void* out, void* in, std::size_t stride) const { run(context.get(), out, in, static_cast<std::ptrdiff_t>(stride)); }

  std::unique_ptr<AVTXContext, ReleaseTransform> context;
  av_tx_fn run = nullptr;
};

}  // namespace earshot
