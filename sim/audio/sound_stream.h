#pragma once

#include <cstdint>
#include <memory>
#include <span>
#include <vector>

#include "sim/audio/fft.h"
#include "sim/audio/sound_clip.h"

namespace earshot {

struct StreamConfig {
  float sample_rate_hz = 16000.f;
  int max_rir_samples = 8000;
  int max_block_samples = 2400;  ///< largest block asked of step()
  int crossfade_samples = 800;   ///< clamped to the block
};

/// Where one agent is in the endless loop of its sound.  A plain value: saved in checkpoints, compared in tests.
struct StreamPosition {
  std::uint64_t sample = 0;       ///< dry samples played since the sound began to play
  std::uint64_t clip_offset = 0;  ///< clip sample at stream sample 0
  bool already_playing = true;    ///< true: the loop has been sounding for ever before sample 0; false: silence before it
};

/// The convolution engine of SoundStream: FFT plans and scratch, one per thread; all state is in the arguments.
class StreamConvolver {
 public:
  StreamConvolver(const StreamConfig& config, int num_channels);
  ~StreamConvolver();
  StreamConvolver(StreamConvolver&&) noexcept;

  /// Writes output [num_channels, block]: the convolution of the endless dry loop with `rir` [num_channels, rir_samples] at stream samples
  /// [position.sample, position.sample + block), cross-faded over config.crossfade_samples from the convolution with `previous`
  /// (same shape or empty: no fade).  Weights are linear, exactly 0 at the first sample and 1 at the end, as x + w (y - x): identical RIRs
  /// give the bits of no fade.  Does not advance `position`.  Silent clip: exact zeros.
  void convolve(const SoundClip& clip, const StreamPosition& position, std::span<const float> rir, std::span<const float> previous,
                int rir_samples, int block, std::span<float> output);

 private:
  struct Impl;
  std::unique_ptr<Impl> impl_;
};

}  // namespace earshot
