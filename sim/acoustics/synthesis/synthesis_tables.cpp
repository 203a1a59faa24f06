// SPDX-License-Identifier: Apache-2.0
#include "sim/acoustics/synthesis/synthesis_tables.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>

#include "sim/acoustics/synthesis/delayed_impulse.h"
#include "sim/acoustics/synthesis/late_array.h"
#include "sim/audio/transforms/fft.h"
#include "sim/base/denormals.h"
#include "sim/base/errors.h"

namespace earshot {
namespace {

/// Longest carrier loop: 4 s at 16 kHz.  A longer response goes round it again in another order (late_carriers.h); making longer ones would
/// take more time than they are worth.
constexpr int kMaxCarrierLength = 1 << 16;
/// Of the many carriers of an array.
constexpr int kMaxArrayCarrierLength = 1 << 15;

/// Highest cutoff of a microphone over the sample rate: there a low-pass rings for 80 samples, at 0.4999 for 38,000, and transforms of
/// every arrival hold them all.
constexpr float kMaxRelativeCutoff = 0.45f;

int count_samples(const AcousticConfig& config) {
  return std::max(1, static_cast<int>(std::lround(static_cast<double>(config.rir_length_s) * config.sample_rate_hz)));
}

/// Room for different segments of noise, and loops that a power-of-two transform can make.
int carrier_length(int num_samples) {
  return std::min(kMaxCarrierLength, next_power_of_two(std::max(num_samples + num_samples / 4, 4096)));
}

/// The FFT size at which filtering `num_samples` with `taps` costs least, by overlap-add.
int choose_block_fft(int num_samples, int taps) {
  int best = 0;
  double lowest = 0;
  for (int size = next_power_of_two(2 * taps); size <= std::max(1 << 17, next_power_of_two(2 * taps)); size *= 2) {
    const int blocks = (num_samples + size - taps) / (size - taps + 1);
    const double cost = blocks * static_cast<double>(size) * std::log2(size);
    if (best == 0 || cost < lowest) best = size, lowest = cost;
  }
  return best;
}

int num_carriers(const ListenerLayout& layout) {
  switch (layout.kind) {
    case ListenerKind::mono:
      return 2;  // one or the other (CarrierBank)
    case ListenerKind::binaural:
      return 4;
    case ListenerKind::ambisonics:
      return std::max(2, layout.num_channels());
    case ListenerKind::array:
      return layout.is_coincident() ? 4 : LateArray::kNumWaves;
  }
  return 1;
}

CarrierBank make_carriers(const ListenerLayout& layout, const AcousticConfig& config, const BandLayout& bands) {
  const bool has_plane_waves = layout.kind == ListenerKind::array && !layout.is_coincident();
  const int length = carrier_length(count_samples(config));
  return {bands,
          config.sample_rate_hz,
          num_carriers(layout),
          has_plane_waves ? std::min(length, kMaxArrayCarrierLength) : length,
          config.seed,
          has_plane_waves ? CarrierKind::plain : CarrierKind::flattened};
}

/// Of the transform of an arrival: room for what low-passes ring behind its middle.
int early_fft_for(const ListenerLayout& layout, float sample_rate_hz) {
  int size = arrival_fft_size(sample_rate_hz);
  for (const Microphone& microphone : layout.microphones)
    if (microphone.lowpass_hz > 0) {
      const LowPass low_pass(static_cast<double>(microphone.lowpass_hz), static_cast<double>(sample_rate_hz));
      size = std::max(size, next_power_of_two(static_cast<int>(std::ceil(2 * low_pass.ring_samples()))));
    }
  return size;
}

}  // namespace

SynthesisTables::SynthesisTables(const AcousticConfig& config, const BandLayout& band_layout, ListenerLayout listener_layout,
                                 std::shared_ptr<const Hrtf> head)
    : bands(band_layout),
      layout(std::move(listener_layout)),
      has_plane_waves(layout.kind == ListenerKind::array && !layout.is_coincident()),
      hrtf(std::move(head)),
      sample_rate_hz(config.sample_rate_hz),
      num_samples(count_samples(config)),
      num_bands(bands.size()),
      glide_paths(config.glide_paths),
      seed(config.seed),
      early_fft(hrtf ? hrtf->fft_size() : early_fft_for(layout, config.sample_rate_hz)),
      filters(bands, config.sample_rate_hz, early_fft, BandShape::line),
      carriers(make_carriers(layout, config, bands)),
      late_decode_samples(static_cast<double>(config.late_decode_s) * static_cast<double>(config.sample_rate_hz)) {
  for (const Microphone& microphone : layout.microphones) patterns.emplace_back(microphone.directivity, bands.centre_hz, bands.edge_hz);
  if (std::ranges::any_of(layout.microphones, [](const Microphone& microphone) { return microphone.lowpass_hz > 0; }))
    for (const Microphone& microphone : layout.microphones) {
      low_passes.emplace_back();
      if (microphone.lowpass_hz > 0)
        low_passes.back().emplace(static_cast<double>(microphone.lowpass_hz), static_cast<double>(sample_rate_hz));
    }
  if (!hrtf) return;
  binaural_noise = BinauralNoise(carriers, bands, *hrtf);
  late_fft = choose_block_fft(num_samples, hrtf->decoder_taps());
  make_decoder();
}

void SynthesisTables::make_decoder() {
  using Complex = std::complex<float>;
  RealFft short_fft(early_fft);
  ComplexFft long_fft(late_fft, ComplexFft::Direction::forward);
  const auto num_taps = static_cast<std::size_t>(hrtf->decoder_taps()), size = static_cast<std::size_t>(late_fft);
  std::array<std::vector<float>, 2> taps;
  for (auto& ear : taps) ear.resize(static_cast<std::size_t>(early_fft));
  std::array<AlignedSpectrum, 4> both_ears;  // of each channel
  for (std::size_t c = 0; c < 4; ++c) {
    for (std::size_t ear = 0; ear < 2; ++ear)
      short_fft.inverse(hrtf->diffuse_decoder(static_cast<int>(c), static_cast<int>(ear)), taps[ear]);
    long_fft.set_input(std::span(taps[0]).first(num_taps), std::span(taps[1]).first(num_taps));
    both_ears[c].resize(size);
    long_fft.transform(both_ears[c]);
  }
  // F0 = (Z + Z~) / 2, F1 = (Z - Z~) / 2i.
  const float half = 0.5f / static_cast<float>(late_fft);
  for (std::size_t pair = 0; pair < 2; ++pair) {
    const AlignedSpectrum &first = both_ears[2 * pair], &second = both_ears[2 * pair + 1];
    for (std::size_t k = 0; k < size; ++k) {
      const Complex turned(-second[k].imag(), second[k].real());  // i times it
      decoder[2 * pair].push_back(half * (first[k] - turned));
      decoder[2 * pair + 1].push_back(half * (first[k] + turned));
    }
  }
}

std::shared_ptr<const SynthesisTables> make_synthesis_tables(const AcousticConfig& config, const BandLayout& bands,
                                                             const ListenerLayout& layout, std::shared_ptr<const Hrtf> hrtf) {
  const FlushDenormals flush;
  require(config.sample_rate_hz >= 8000.f && config.sample_rate_hz <= 96000.f, "sample_rate_hz", config.sample_rate_hz,
          "must be in [8000, 96000]");
  require(config.rir_length_s > 0 && config.rir_length_s <= 60, "rir_length_s", config.rir_length_s, "must be in (0, 60]");
  require(config.late_decode_s >= 0 && config.late_decode_s <= 60, "late_decode_s", config.late_decode_s, "must be in [0, 60] s");
  validate(layout);
  for (const Microphone& microphone : layout.microphones)
    require(microphone.lowpass_hz <= kMaxRelativeCutoff * config.sample_rate_hz, "lowpass_hz", microphone.lowpass_hz,
            fmt::format("must be at most {} of the sample rate, {} Hz: nearer to half of the sample rate it rings too long",
                        kMaxRelativeCutoff, kMaxRelativeCutoff * config.sample_rate_hz));
  if (layout.kind != ListenerKind::binaural) return std::make_shared<const SynthesisTables>(config, bands, layout, nullptr);
  if (!hrtf) hrtf = Hrtf::rigid_sphere(config.sample_rate_hz);
  require(hrtf->sample_rate_hz() == config.sample_rate_hz, "sample_rate_hz", config.sample_rate_hz,
          "must equal the sample rate of the HRTF");
  return std::make_shared<const SynthesisTables>(config, bands, layout, std::move(hrtf));
}

}  // namespace earshot
