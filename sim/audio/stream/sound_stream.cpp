// SPDX-License-Identifier: Apache-2.0
#include "sim/audio/stream/sound_stream.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <numeric>

#include "sim/audio/transforms/fft.h"
#include "sim/audio/transforms/spectrum_math.h"
#include "sim/base/denormals.h"
#include "sim/base/errors.h"

namespace earshot {
namespace {

using Complex = std::complex<float>;
using Direction = ComplexFft::Direction;

constexpr int kSmallestLog2 = 6, kLargestLog2 = 17;

int ceil_divide(int a, int b) { return (a + b - 1) / b; }

/// Time of one block in units of a multiplication of complex numbers, fitted to libavutil with AVX2.
double cost_of(const StreamPlan& plan, int block, int fade, int taps, int num_pairs) {
  const double size = plan.fft_size, transform = 0.4 * size * std::log2(size);
  const double parts = ceil_divide(taps, plan.part), pieces = ceil_divide(block, plan.piece) + ceil_divide(fade, plan.piece);
  // Segments of the dry sound lie on a grid as fine as the common divisor of piece and part: that many of them are new in each piece.
  const int grid = std::gcd(plan.piece, plan.part);
  const double new_segments = std::min(parts, static_cast<double>(plan.part == grid ? 1 : plan.part / grid));
  return num_pairs * (parts * (transform + size) + pieces * (transform + size) + pieces * parts * size) +
         ceil_divide(block, plan.piece) * new_segments * (transform + size);
}

}  // namespace

StreamPosition::Segment StreamPosition::segment(std::uint64_t back, std::size_t size) const {
  // Of stream samples below 2^63, so that a segment that begins before sample 0 has a negative start.
  const auto start = static_cast<std::int64_t>(sample) - static_cast<std::int64_t>(back);
  const auto most = static_cast<std::int64_t>(size);
  const auto last = static_cast<std::int64_t>(std::min<std::uint64_t>(end, std::uint64_t{1} << 62));
  const std::int64_t silent = already_playing ? 0 : std::clamp<std::int64_t>(static_cast<std::int64_t>(begin) - start, 0, most);
  const std::int64_t until = std::clamp<std::int64_t>(last - start, silent, most);
  return {static_cast<std::size_t>(silent), static_cast<std::size_t>(until - silent)};
}

struct StreamConvolver::Impl {
  Impl(const StreamConfig& settings, int channel_count, std::shared_ptr<DrySpectra> shared)
      : config(settings),
        num_channels(static_cast<std::size_t>(channel_count)),
        num_pairs((num_channels + 1) / 2),
        plan(StreamConvolver::plan(settings, channel_count)),
        size(static_cast<std::size_t>(plan.fft_size)),
        dry_spectra(std::move(shared)),
        forward(plan.fft_size, Direction::forward),
        inverse(plan.fft_size, Direction::inverse),
        segment(size),
        stretch_spectrum(size),
        sums(2 * num_pairs * size) {}

  /// Writes `target.size()` samples of the dry loop that begin `back` samples before position.sample.
  static void copy_dry(const SoundClip& clip, const StreamPosition& position, std::uint64_t back, std::span<float> target) {
    const std::uint64_t length = clip.samples.size();
    const auto [silent, sounding] = position.segment(back, target.size());
    std::fill_n(target.begin(), silent, 0.f);
    std::fill(target.begin() + static_cast<std::ptrdiff_t>(silent + sounding), target.end(), 0.f);
    std::uint64_t index = (start_in_loop(clip, position, back) + silent) % length;
    for (std::size_t done = silent; done < silent + sounding;) {
      const auto count = static_cast<std::size_t>(std::min<std::uint64_t>(length - index, silent + sounding - done));
      std::copy_n(clip.samples.begin() + static_cast<std::ptrdiff_t>(index), count, target.begin() + static_cast<std::ptrdiff_t>(done));
      done += count;
      index = 0;
    }
  }
  static std::uint64_t start_in_loop(const SoundClip& clip, const StreamPosition& position, std::uint64_t back) {
    const std::uint64_t length = clip.samples.size();
    return (position.clip_offset % length + position.sample % length + length - back % length) % length;
  }

  /// Spectrum of the segment of dry sound that part `part` of a RIR meets in the piece that begins at `position`, over the FFT size.
  DrySpectra::View dry(const SoundClip& clip, std::uint64_t clip_key, const StreamPosition& position, int part) {
    const std::uint64_t back =
        static_cast<std::uint64_t>(part) * static_cast<std::uint64_t>(plan.part) + size - static_cast<std::uint64_t>(plan.piece);
    const auto make = [&](std::span<Complex> spectrum) {
      copy_dry(clip, position, back, segment);
      // Once in the stored spectrum, not in every inverse transform; a power of two costs no digits.
      const float scale = 1.f / static_cast<float>(size);
      for (float& value : segment) value *= scale;
      forward.set_input(segment, {});
      forward.transform(spectrum);
    };
    if (dry_spectra && clip_key != 0 && position.segment(back, size).sounding == size)
      return dry_spectra->get(clip_key, start_in_loop(clip, position, back), stretch_spectrum, make);
    make(stretch_spectrum);
    return DrySpectra::View(stretch_spectrum);
  }

  [[nodiscard]] std::span<Complex> sum(std::size_t generation, std::size_t pair) {
    return std::span(sums).subspan((generation * num_pairs + pair) * size, size);
  }

  /// Taps up to the last that is not zero in any channel.
  [[nodiscard]] int last_tap(std::span<const float> rir, std::size_t rir_samples) const {
    std::size_t taps = 0;
    for (std::size_t channel = 0; channel < num_channels; ++channel) {
      std::size_t end = rir_samples;
      while (end > taps && rir[channel * rir_samples + end - 1] == 0.f) --end;
      taps = std::max(taps, end);
    }
    return static_cast<int>(taps);
  }

  StreamConfig config;
  std::size_t num_channels, num_pairs;
  StreamPlan plan;
  std::size_t size;  ///< of the transforms
  std::shared_ptr<DrySpectra> dry_spectra;
  ComplexFft forward, inverse;
  std::vector<float> segment;
  AlignedSpectrum stretch_spectrum;
  std::vector<Complex> sums;  ///< [now, previous][pair][size]
  RirSpectra own_now, own_previous;
};

StreamPlan StreamConvolver::plan(const StreamConfig& config, int num_channels) {
  // Not the configured fade: bits do not depend on samples that are not heard.
  const int block = config.max_block_samples, fade = ceil_divide(block, 3);
  StreamPlan best;
  double lowest = 0;
  const int whole = next_power_of_two(config.max_rir_samples + block);
  for (int size = 1 << kSmallestLog2; size <= std::clamp(whole, 1 << kSmallestLog2, 1 << kLargestLog2); size *= 2) {
    for (int pieces = 1; pieces <= 64; ++pieces) {
      const int piece = ceil_divide(block, pieces), room = size - piece + 1;
      if (room < 1 || (pieces > 1 && piece == ceil_divide(block, pieces - 1))) continue;
      for (const int divisor : {1, 2, 3, 4}) {
        if (piece % divisor != 0 || room < piece / divisor) continue;
        const int grid = piece / divisor;
        const StreamPlan candidate{size, piece, room / grid * grid};
        const double cost = cost_of(candidate, block, fade, config.max_rir_samples, (num_channels + 1) / 2);
        if (best.fft_size != 0 && cost >= lowest) continue;
        best = candidate;
        lowest = cost;
      }
    }
  }
  return best;
}

StreamConvolver::StreamConvolver(const StreamConfig& config, int num_channels, std::shared_ptr<DrySpectra> dry_spectra) {
  require(num_channels >= 1 && num_channels <= 64, "num_channels", num_channels, "must be in [1, 64]");
  require(config.max_rir_samples >= 1 && config.max_rir_samples <= 1 << 23, "stream.max_rir_samples", config.max_rir_samples,
          "must be in [1, 2^23]");
  require(config.max_block_samples >= 1 && config.max_block_samples <= 1 << 22, "stream.max_block_samples", config.max_block_samples,
          "must be in [1, 2^22]");
  require(config.crossfade_samples >= 0, "stream.crossfade_samples", config.crossfade_samples, "must not be negative");
  impl_ = std::make_unique<Impl>(config, num_channels, std::move(dry_spectra));
  require(!impl_->dry_spectra || impl_->dry_spectra->fft_size() == impl_->plan.fft_size, "size of the shared spectra",
          impl_->dry_spectra ? impl_->dry_spectra->fft_size() : 0, "must be that of StreamConvolver::plan");
}
StreamConvolver::~StreamConvolver() = default;
StreamConvolver::StreamConvolver(StreamConvolver&&) noexcept = default;

void StreamConvolver::transform(std::span<const float> rir, int rir_samples, RirSpectra& spectra) {
  const FlushDenormals flush;
  Impl& in = *impl_;
  EARSHOT_EXPECT(rir_samples >= 0 && rir_samples <= in.config.max_rir_samples);
  const auto length = static_cast<std::size_t>(rir_samples), part = static_cast<std::size_t>(in.plan.part);
  EARSHOT_EXPECT(rir.size() == length * in.num_channels);
  const int taps = in.last_tap(rir, length);
  spectra.num_parts_ = ceil_divide(taps, in.plan.part);
  const auto num_parts = static_cast<std::size_t>(spectra.num_parts_);
  // At once for the longest response, so that later ones find room.
  const auto most_parts = static_cast<std::size_t>(ceil_divide(in.config.max_rir_samples, in.plan.part));
  if (spectra.values_.size() < in.num_pairs * most_parts * in.size) spectra.values_.resize(in.num_pairs * most_parts * in.size);
  for (std::size_t pair = 0; pair < in.num_pairs; ++pair) {
    const auto channel = [&](std::size_t index, std::size_t first, std::size_t count) {
      return index < in.num_channels ? rir.subspan(index * length + first, count) : std::span<const float>();
    };
    for (std::size_t p = 0; p < num_parts; ++p) {
      const std::size_t count = std::min(part, static_cast<std::size_t>(taps) - p * part);
      in.forward.set_input(channel(2 * pair, p * part, count), channel(2 * pair + 1, p * part, count));
      in.forward.transform(std::span(spectra.values_).subspan((pair * num_parts + p) * in.size, in.size));
    }
  }
}

void StreamConvolver::convolve(const SoundClip& clip, std::uint64_t clip_key, const StreamPosition& position, const RirSpectra& rir,
                               const RirSpectra* previous, int block, std::span<float> output) {
  const FlushDenormals flush;
  Impl& in = *impl_;
  const auto width = static_cast<std::size_t>(block);
  EARSHOT_EXPECT(block >= 0 && block <= in.config.max_block_samples && output.size() >= width * in.num_channels);
  std::fill_n(output.begin(), width * in.num_channels, 0.f);
  if (clip.samples.empty()) return;
  const int fade = previous != nullptr ? std::min(in.config.crossfade_samples, block) : 0;
  const std::array<const RirSpectra*, 2> responses = {&rir, previous};

  for (int begin = 0; begin < block; begin += in.plan.piece) {
    StreamPosition piece_position = position;
    piece_position.sample += static_cast<std::uint64_t>(begin);
    const std::size_t generations = begin < fade ? 2 : 1;
    for (std::size_t g = 0; g < generations; ++g)
      for (std::size_t pair = 0; pair < in.num_pairs; ++pair) std::ranges::fill(in.sum(g, pair), Complex{});
    const int num_parts = std::max(rir.num_parts(), generations > 1 ? previous->num_parts() : 0);
    for (int part = 0; part < num_parts; ++part) {
      const DrySpectra::View dry = in.dry(clip, clip_key, piece_position, part);
      for (std::size_t g = 0; g < generations; ++g) {
        if (part >= responses[g]->num_parts()) continue;
        for (std::size_t pair = 0; pair < in.num_pairs; ++pair) {
          const std::size_t row = pair * static_cast<std::size_t>(responses[g]->num_parts()) + static_cast<std::size_t>(part);
          multiply_add(dry.spectrum(), std::span(responses[g]->values_).subspan(row * in.size, in.size), in.sum(g, pair));
        }
      }
    }

    const auto count = static_cast<std::size_t>(std::min(in.plan.piece, block - begin));
    const std::size_t first = in.size - static_cast<std::size_t>(in.plan.piece);  // earlier samples hold the wrap-around
    for (std::size_t pair = 0; pair < in.num_pairs; ++pair) {
      float* left = output.data() + 2 * pair * width + static_cast<std::size_t>(begin);
      float* right = 2 * pair + 1 < in.num_channels ? left + width : nullptr;
      std::ranges::copy(in.sum(0, pair), in.inverse.input().begin());
      const Complex* now = in.inverse.transform().data() + first;
      for (std::size_t i = 0; i < count; ++i) left[i] = now[i].real();
      for (std::size_t i = 0; right != nullptr && i < count; ++i) right[i] = now[i].imag();
      if (generations == 1) continue;
      std::ranges::copy(in.sum(1, pair), in.inverse.input().begin());
      const Complex* before = in.inverse.transform().data() + first;
      const std::size_t faded = std::min(count, static_cast<std::size_t>(fade - begin));
      for (std::size_t i = 0; i < faded; ++i) {
        const float weight = static_cast<float>(begin + static_cast<int>(i)) / static_cast<float>(fade);
        left[i] = before[i].real() + weight * (left[i] - before[i].real());
        if (right != nullptr) right[i] = before[i].imag() + weight * (right[i] - before[i].imag());
      }
    }
  }
}

void StreamConvolver::convolve(const SoundClip& clip, const StreamPosition& position, std::span<const float> rir,
                               std::span<const float> previous, int rir_samples, int block, std::span<float> output) {
  transform(rir, rir_samples, impl_->own_now);
  const bool fades = !previous.empty() && !std::equal(previous.begin(), previous.end(), rir.begin(), rir.end());
  if (fades) transform(previous, static_cast<int>(previous.size() / impl_->num_channels), impl_->own_previous);
  convolve(clip, 0, position, impl_->own_now, fades ? &impl_->own_previous : nullptr, block, output);
}

}  // namespace earshot
