// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <memory>
#include <span>
#include <vector>

#include "sim/audio/dry_sounds/dry_spectra.h"
#include "sim/audio/dry_sounds/sound_clip.h"

namespace earshot {

struct StreamConfig {
  float sample_rate_hz = 16000.f;
  int max_rir_samples = 8000;
  int max_block_samples = 2400;  ///< largest block of a call
  int crossfade_samples = 800;   ///< clamped to the block
};

/// Where one agent is in the endless loop of its sound.  A plain value: saved in checkpoints, compared in tests.
struct StreamPosition {
  std::uint64_t sample = 0;       ///< of the stream: dry samples since its sample 0
  std::uint64_t clip_offset = 0;  ///< clip sample at stream sample 0
  bool already_playing = true;    ///< true: the loop has been playing without beginning before sample 0; false: silence before `begin`
  std::uint64_t begin = 0;        ///< stream sample at which a loop that has not been playing begins
  std::uint64_t end = ~std::uint64_t{0};  ///< stream sample from which the dry sound is silent; earlier sound rings on

  /// Dry samples of the segment of `size` stream samples that begins `back` before `sample`: silence, sound, silence.
  struct Segment {
    std::size_t silent_before, sounding;
  };
  [[nodiscard]] Segment segment(std::uint64_t back, std::size_t size) const;
  /// The same place `later` samples later.
  [[nodiscard]] StreamPosition after(std::uint64_t later) const {
    StreamPosition moved = *this;
    moved.sample += later;
    return moved;
  }
  /// The sound begun anew at this sample, without what rings of it; silence where it is not playing now.
  [[nodiscard]] StreamPosition begun_anew() const {
    StreamPosition anew = *this;
    anew.sample = begin;
    anew.already_playing = false;
    anew.end = (already_playing || sample >= begin) && sample < end ? ~std::uint64_t{0} : begin;
    return anew;
  }
};

/// How a StreamConvolver cuts its work (StreamConvolver::plan): overlap-save with transforms of `fft_size` samples, each giving `piece`
/// samples of `part` taps; part + piece <= fft_size + 1.
struct StreamPlan {
  int fft_size = 0, piece = 0, part = 0;
};

/// Spectra of the parts of one RIR: made once, used while it and the one after it are heard.  Empty until StreamConvolver::transform.
class RirSpectra {
 public:
  [[nodiscard]] int num_parts() const { return num_parts_; }

 private:
  friend class StreamConvolver;
  int num_parts_ = 0;
  AlignedSpectrum values_;  ///< [pair of channels][part][fft_size]
};

/// The convolution engine of SoundStream: FFT plans and scratch, one per thread; all state is in the arguments.  Uniformly partitioned
/// convolution (Kulp 1988); two channels travel as real and imaginary part of one signal, so that the quieter of a pair has the rounding
/// of the louder, 1e-7 of it.
class StreamConvolver {
 public:
  /// dry_spectra: shared with other convolvers of the same plan; null: none are cached.
  StreamConvolver(const StreamConfig& config, int num_channels, std::shared_ptr<DrySpectra> dry_spectra = nullptr);
  ~StreamConvolver();
  StreamConvolver(StreamConvolver&&) noexcept;

  /// The plan of the least work for blocks of max_block_samples with a new RIR of max_rir_samples in each.
  static StreamPlan plan(const StreamConfig& config, int num_channels);

  /// rir: [num_channels, rir_samples], rir_samples at most config.max_rir_samples.  About 30 us for two channels of 0.5 s at 16 kHz.  No
  /// allocation from the second call for `spectra` on.
  void transform(std::span<const float> rir, int rir_samples, RirSpectra& spectra);

  /// Writes output [num_channels, block]: the convolution of the endless dry loop with `rir` at stream samples [position.sample,
  /// position.sample + block), cross-faded over config.crossfade_samples from the convolution with `previous` (null: no fade).  Weights are
  /// linear, exactly 0 at the first sample and 1 at the end, as x + w (y - x): identical RIRs give the bits of no fade.  Does not advance
  /// `position`.  Silent clip: exact zeros.  clip_key: hash of the clip's samples, by which its spectra are shared; 0: they are not.  The
  /// bits depend on neither.  No allocation.
  void convolve(const SoundClip& clip, std::uint64_t clip_key, const StreamPosition& position, const RirSpectra& rir,
                const RirSpectra* previous, int block, std::span<float> output);
  /// The same of responses in time: rir [num_channels, rir_samples], previous of as many channels and any length, or empty.
  void convolve(const SoundClip& clip, const StreamPosition& position, std::span<const float> rir, std::span<const float> previous,
                int rir_samples, int block, std::span<float> output);

 private:
  struct Impl;
  std::unique_ptr<Impl> impl_;
};

}  // namespace earshot
