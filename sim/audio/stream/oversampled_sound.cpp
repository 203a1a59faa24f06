// SPDX-License-Identifier: Apache-2.0
#include "sim/audio/stream/oversampled_sound.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstring>
#include <numbers>

#include "sim/base/errors.h"

namespace earshot {
namespace {

/// Taps on either side of the sample between two samples of the clip.  With the window below, 60 dB and a transition of 1.4 % of the rate.
constexpr int kHalfDoubling = 128;
constexpr double kDoublingShape = 5.65;
/// Taps of the reader, at twice the rate: the sound fills half of its band, so few are enough for 65 dB.
constexpr int kTaps = 8;
constexpr double kReaderShape = 6.2;
/// Places between two samples; the nearest is as good as the taps.
constexpr int kPhaseBits = 10, kPhases = 1 << kPhaseBits;
constexpr std::size_t kGuard = kTaps;

double sinc(double x) { return x == 0 ? 1.0 : std::sin(std::numbers::pi * x) / (std::numbers::pi * x); }

/// Modified Bessel function of order 0 by its power series; x up to about 10.  std::cyl_bessel_i writes a global (signgam), which is a
/// race where environments are made in several threads.
double bessel_i0(double x) {
  double term = 1, sum = 1;
  for (int k = 1; term > 1e-17 * sum; ++k) sum += term *= x * x / (4.0 * k * k);
  return sum;
}

/// Kaiser's window at x in [-1, 1].
double kaiser(double x, double shape) { return std::abs(x) >= 1 ? 0.0 : bessel_i0(shape * std::sqrt(1 - x * x)) / bessel_i0(shape); }

/// Taps of the reader for kPhases + 1 places between two samples: [phase][tap].
struct Reader {
  Reader() {
    for (int phase = 0; phase <= kPhases; ++phase) {
      std::array<double, kTaps> exact;
      double sum = 0;
      for (int k = 0; k < kTaps; ++k) {
        const double apart = k - (kTaps / 2 - 1) - static_cast<double>(phase) / kPhases;
        sum += exact[static_cast<std::size_t>(k)] = sinc(apart) * kaiser(apart / (kTaps / 2), kReaderShape);
      }
      for (int k = 0; k < kTaps; ++k) taps[phase][k] = static_cast<float>(exact[static_cast<std::size_t>(k)] / sum);
    }
  }
  alignas(64) float taps[kPhases + 1][kTaps];
};

const Reader& reader() {
  static const Reader instance;
  return instance;
}

using Eight = float __attribute__((vector_size(32)));

Eight load(const float* from) {
  Eight value;
  std::memcpy(&value, from, sizeof value);
  return value;
}

float sum_of(Eight v) { return ((v[0] + v[4]) + (v[1] + v[5])) + ((v[2] + v[6]) + (v[3] + v[7])); }

}  // namespace

OversampledSound::OversampledSound(const SoundClip& clip) : length_(clip.samples.size()) {
  if (clip.samples.empty()) return;
  silent_ = std::ranges::all_of(clip.samples, [](float sample) { return sample == 0.f; });
  std::array<float, 2 * kHalfDoubling> taps;
  double sum = 0;
  for (std::size_t k = 0; k < taps.size(); ++k) {
    const double apart = static_cast<double>(k) - kHalfDoubling + 0.5;
    sum += taps[k] = static_cast<float>(sinc(apart) * kaiser(apart / kHalfDoubling, kDoublingShape));
  }
  for (float& tap : taps) tap = static_cast<float>(static_cast<double>(tap) / sum);
  std::vector<float> around(length_ + taps.size());  // the loop and more of it
  for (std::size_t i = 0; i < around.size(); ++i) around[i] = clip.samples[i % length_];

  samples_.resize(2 * length_ + 2 * kGuard);
  for (std::size_t n = 0; n < length_; ++n) {
    samples_[kGuard + 2 * n] = clip.samples[n];
    // Between samples n and n + 1: the first tap meets sample n - (kHalfDoubling - 1).
    const float* from = around.data() + (n + length_ * kHalfDoubling - (kHalfDoubling - 1)) % length_;
    Eight part{};
    for (std::size_t k = 0; k < taps.size(); k += 8) part += load(from + k) * load(taps.data() + k);
    samples_[kGuard + 2 * n + 1] = sum_of(part);
  }
  for (std::size_t i = 0; i < kGuard; ++i) {
    samples_[kGuard + 2 * length_ + i] = samples_[kGuard + i % (2 * length_)];
    samples_[kGuard - 1 - i] = samples_[kGuard + 2 * length_ - 1 - i % (2 * length_)];
  }
}

void OversampledSound::read(const StreamPosition& position, double first, double step, std::span<float> out) const {
  EARSHOT_EXPECT(step > 0 && step <= 4);
  if (silent_) {
    std::ranges::fill(out, 0.f);
    return;
  }
  // Places in the doubled loop as whole samples and parts of 2^-32: no drift over a block, and a loop of any length.
  const double whole = std::floor(2.0 * first);
  const auto loop = static_cast<std::int64_t>(2 * length_);
  const auto start = static_cast<std::int64_t>((position.clip_offset % length_ + position.sample % length_) % length_);
  std::int64_t index = (2 * start + static_cast<std::int64_t>(whole) % loop + loop) % loop;
  auto part = static_cast<std::uint64_t>((2.0 * first - whole) * 4294967296.0);
  const auto advance = static_cast<std::uint64_t>(2.0 * step * 4294967296.0);

  std::size_t i = 0, end = out.size();
  /// Samples of `out` that lie before a stream sample.
  const auto before = [&](std::uint64_t stream_sample) {
    const double count = std::ceil((static_cast<double>(stream_sample) - static_cast<double>(position.sample) - first) / step);
    return static_cast<std::size_t>(std::clamp(count, 0.0, static_cast<double>(out.size())));
  };
  if (position.end != ~std::uint64_t{0}) {
    end = before(position.end);
    std::fill(out.begin() + static_cast<std::ptrdiff_t>(end), out.end(), 0.f);
  }
  if (!position.already_playing) {
    const std::size_t silent_samples = std::min(before(position.begin), end);
    std::fill_n(out.begin(), silent_samples, 0.f);
    part += silent_samples * (advance & 0xFFFFFFFFu);
    index = (index + static_cast<std::int64_t>(silent_samples * (advance >> 32)) + static_cast<std::int64_t>(part >> 32)) % loop;
    part &= 0xFFFFFFFFu;
    i = silent_samples;
  }
  const Reader& table = reader();
  const float* samples = samples_.data() + kGuard - (kTaps / 2 - 1);
  for (; i < end; ++i) {
    const auto phase = static_cast<std::size_t>((part + (1u << (31 - kPhaseBits))) >> (32 - kPhaseBits));
    out[i] = sum_of(load(samples + index) * load(table.taps[phase]));
    part += advance;
    index += static_cast<std::int64_t>(part >> 32);
    part &= 0xFFFFFFFFu;
    if (index >= loop) index %= loop;
  }
}

}  // namespace earshot
