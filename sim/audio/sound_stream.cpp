#include "sim/audio/sound_stream.h"

#include <algorithm>
#include <cmath>
#include <complex>

#include "sim/audio/spectrum_math.h"
#include "sim/base/errors.h"

namespace earshot {
namespace {

using Complex = std::complex<float>;

constexpr int kSmallestLog2 = 7;
constexpr int kLargestLog2 = 17;  ///< beyond it the caches are lost, and parts of the RIR cost less than one long transform

}  // namespace

/// Overlap-save convolution with the impulse response in equal parts (Kulp 1988): a transform of N samples gives `block` outputs of
/// N - block + 1 taps.  N is the one with the fewest operations for this block and length.
struct StreamConvolver::Impl {
  Impl(const StreamConfig& settings, int channel_count) : config(settings), num_channels(channel_count) {
    // Larger transforms never pay: twice the block is the least that makes sense, the whole job in one transform the most.
    const int whole = next_power_of_two(config.max_rir_samples + config.max_block_samples);
    const int most = std::clamp(whole, 1 << kSmallestLog2, std::max(1 << kLargestLog2, next_power_of_two(2 * config.max_block_samples)));
    for (int size = 1 << kSmallestLog2; size <= most; size *= 2) transforms.emplace_back(size);
    segment.resize(static_cast<std::size_t>(most));
    const auto bins = static_cast<std::size_t>(most / 2 + 1);
    segment_spectrum.resize(bins);
    part_spectrum.resize(bins);
    sums.resize(bins * static_cast<std::size_t>(num_channels));
    faded.resize(static_cast<std::size_t>(config.crossfade_samples) * static_cast<std::size_t>(num_channels));
  }

  RealFft& transform_for(int block, int taps) {
    RealFft* best = nullptr;
    double lowest = 0;
    for (RealFft& transform : transforms) {
      const int room = transform.size() - block + 1;
      if (room < 1) continue;
      const int parts = (taps + room - 1) / room;
      const double cost = (parts * (1.0 + num_channels) + num_channels) * transform.size() * std::log2(transform.size());
      if (best && cost >= lowest) continue;
      best = &transform;
      lowest = cost;
    }
    return *best;
  }

  /// Writes stream samples [position.sample - back, ... + target.size()) of the dry loop.  Returns false if all are zero.
  static bool copy_dry(const SoundClip& clip, const StreamPosition& position, std::uint64_t back, std::span<float> target) {
    const std::uint64_t length = clip.samples.size();
    std::size_t silent = 0;
    if (!position.already_playing && back > position.sample)
      silent = static_cast<std::size_t>(std::min<std::uint64_t>(back - position.sample, target.size()));
    std::fill_n(target.begin(), silent, 0.f);
    std::uint64_t index = (position.clip_offset % length + position.sample % length + length - back % length + silent) % length;
    for (std::size_t done = silent; done < target.size();) {
      const auto count = static_cast<std::size_t>(std::min<std::uint64_t>(length - index, target.size() - done));
      std::copy_n(clip.samples.begin() + static_cast<std::ptrdiff_t>(index), count, target.begin() + static_cast<std::ptrdiff_t>(done));
      done += count;
      index = 0;
    }
    return std::any_of(target.begin(), target.end(), [](float value) { return value != 0.f; });
  }

  /// output [num_channels] rows of `block` samples, `stride` apart.
  void convolve(const SoundClip& clip, const StreamPosition& position, std::span<const float> rir, int rir_samples, int block,
                std::span<float> output, int stride) {
    const int taps = last_tap(rir, rir_samples);
    const auto width = static_cast<std::size_t>(block);
    for (int channel = 0; channel < num_channels; ++channel)
      std::fill_n(output.begin() + static_cast<std::ptrdiff_t>(channel) * stride, width, 0.f);
    if (taps == 0 || clip.samples.empty()) return;

    RealFft& fft = transform_for(block, taps);
    const int room = fft.size() - block + 1;
    const auto size = static_cast<std::size_t>(fft.size()), bins = static_cast<std::size_t>(fft.num_bins());
    const auto sum_of = [&](int channel) { return std::span(sums).subspan(static_cast<std::size_t>(channel) * bins, bins); };
    std::fill_n(sums.begin(), bins * static_cast<std::size_t>(num_channels), Complex{});
    const auto dry = std::span(segment).first(size);
    const auto dry_spectrum = std::span(segment_spectrum).first(bins), tap_spectrum = std::span(part_spectrum).first(bins);
    bool sounding = false;
    for (int first = 0; first < taps; first += room) {
      if (!copy_dry(clip, position, static_cast<std::uint64_t>(first + room - 1), dry)) continue;
      sounding = true;
      fft.forward(dry, dry_spectrum);
      const auto count = static_cast<std::size_t>(std::min(room, taps - first));
      for (int channel = 0; channel < num_channels; ++channel) {
        fft.forward(
            rir.subspan(static_cast<std::size_t>(channel) * static_cast<std::size_t>(rir_samples) + static_cast<std::size_t>(first), count),
            tap_spectrum);
        multiply_add(dry_spectrum, tap_spectrum, sum_of(channel));
      }
    }
    if (!sounding) return;
    for (int channel = 0; channel < num_channels; ++channel) {
      fft.inverse(sum_of(channel), dry);
      // The first room - 1 samples hold the wrap-around.
      std::copy_n(dry.begin() + (room - 1), width, output.begin() + static_cast<std::ptrdiff_t>(channel) * stride);
    }
  }

  /// Taps up to the last that is not zero in any channel.
  [[nodiscard]] int last_tap(std::span<const float> rir, int rir_samples) const {
    int taps = 0;
    for (int channel = 0; channel < num_channels; ++channel) {
      int end = rir_samples;
      while (end > taps &&
             rir[static_cast<std::size_t>(channel) * static_cast<std::size_t>(rir_samples) + static_cast<std::size_t>(end - 1)] == 0.f)
        --end;
      taps = std::max(taps, end);
    }
    return taps;
  }

  StreamConfig config;
  int num_channels;
  std::vector<RealFft> transforms;  ///< sizes 2^7, 2^8, ...
  std::vector<float> segment;
  std::vector<Complex> segment_spectrum, part_spectrum, sums;
  std::vector<float> faded;  ///< the fading part of the convolution with the previous RIR
};

StreamConvolver::StreamConvolver(const StreamConfig& config, int num_channels) {
  require(num_channels >= 1 && num_channels <= 64, "num_channels", num_channels, "must be in [1, 64]");
  require(config.max_rir_samples >= 1 && config.max_rir_samples <= 1 << 23, "stream.max_rir_samples", config.max_rir_samples,
          "must be in [1, 2^23]");
  require(config.max_block_samples >= 1 && config.max_block_samples <= 1 << 22, "stream.max_block_samples", config.max_block_samples,
          "must be in [1, 2^22]");
  require(config.crossfade_samples >= 0, "stream.crossfade_samples", config.crossfade_samples, "must not be negative");
  StreamConfig checked = config;
  checked.crossfade_samples = std::min(config.crossfade_samples, config.max_block_samples);
  impl_ = std::make_unique<Impl>(checked, num_channels);
}
StreamConvolver::~StreamConvolver() = default;
StreamConvolver::StreamConvolver(StreamConvolver&&) noexcept = default;

void StreamConvolver::convolve(const SoundClip& clip, const StreamPosition& position, std::span<const float> rir,
                               std::span<const float> previous, int rir_samples, int block, std::span<float> output) {
  Impl& in = *impl_;
  EARSHOT_EXPECT(block >= 0 && block <= in.config.max_block_samples && rir_samples >= 0 && rir_samples <= in.config.max_rir_samples);
  EARSHOT_EXPECT(rir.size() == static_cast<std::size_t>(rir_samples) * static_cast<std::size_t>(in.num_channels));
  EARSHOT_EXPECT(previous.empty() || previous.size() == rir.size());
  EARSHOT_EXPECT(output.size() >= static_cast<std::size_t>(block) * static_cast<std::size_t>(in.num_channels));
  if (block == 0) return;
  in.convolve(clip, position, rir, rir_samples, block, output, block);

  const int fade = std::min(in.config.crossfade_samples, block);
  if (fade == 0 || previous.empty() || std::equal(previous.begin(), previous.end(), rir.begin())) return;
  in.convolve(clip, position, previous, rir_samples, fade, in.faded, fade);
  for (int channel = 0; channel < in.num_channels; ++channel) {
    const float* old_sound = in.faded.data() + static_cast<std::ptrdiff_t>(channel) * fade;
    float* sound = output.data() + static_cast<std::ptrdiff_t>(channel) * block;
    for (int i = 0; i < fade; ++i) {
      const float weight = static_cast<float>(i) / static_cast<float>(fade);
      sound[i] = old_sound[i] + weight * (sound[i] - old_sound[i]);
    }
  }
}

}  // namespace earshot
