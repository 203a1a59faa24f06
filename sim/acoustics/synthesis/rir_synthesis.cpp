// SPDX-License-Identifier: Apache-2.0
#include "sim/acoustics/synthesis/rir_synthesis.h"

#include <algorithm>
#include <array>
#include <bit>
#include <cmath>
#include <complex>
#include <cstdint>
#include <cstring>
#include <glm/geometric.hpp>
#include <numbers>
#include <optional>

#include "sim/acoustics/synthesis/arrival_spectrum.h"
#include "sim/acoustics/synthesis/binaural_late_tail.h"
#include "sim/acoustics/synthesis/decoded_bins.h"
#include "sim/acoustics/synthesis/delayed_impulse.h"
#include "sim/acoustics/synthesis/late_array.h"
#include "sim/acoustics/synthesis/late_synthesis.h"
#include "sim/acoustics/synthesis/microphone_wave.h"
#include "sim/acoustics/synthesis/synthesis_tables.h"
#include "sim/audio/head/ambisonics.h"
#include "sim/audio/head/harmonic_rotation.h"
#include "sim/audio/transforms/complex_fft.h"
#include "sim/audio/transforms/fft.h"
#include "sim/audio/transforms/spectrum_math.h"
#include "sim/base/denormals.h"
#include "sim/base/errors.h"

namespace earshot {
namespace {

using Complex = std::complex<float>;

/// Of LateCarriers.
constexpr std::uint32_t kFieldStream = 0;

// Plain loops over __restrict pointers: else they are not vectorized.

/// out(k) = conj in(-k).  size: a multiple of four.
void mirror(std::span<const Complex> in, std::span<Complex> out) {
  // Four bins at a time, each a number of eight bytes: the compiler alone goes one by one, four times as long.
  using FourBins = std::uint64_t __attribute__((vector_size(32)));
  constexpr auto minus_imaginary = std::bit_cast<std::uint64_t>(std::array{0.f, -0.f});
  const std::size_t size = in.size();
  for (std::size_t k = 1; k + 4 <= size; k += 4) {
    FourBins bins;
    std::memcpy(&bins, in.data() + (size - k - 3), sizeof bins);
    bins = __builtin_shufflevector(bins, bins, 3, 2, 1, 0) ^ minus_imaginary;
    std::memcpy(static_cast<void*>(out.data() + k), &bins, sizeof bins);
  }
  out[0] = std::conj(in[0]);
  for (std::size_t k = size - 3; k < size; ++k) out[k] = std::conj(in[size - k]);
}

/// See SynthesisTables::decoder.
void decode(const std::array<AlignedSpectrum, 4>& decoder, const std::array<AlignedSpectrum, 2>& pair,
            const std::array<AlignedSpectrum, 2>& mirrored, std::span<Complex> ears) {
  Complex* __restrict sum = ears.data();
  const std::array<const Complex*, 4> factor = {decoder[0].data(), decoder[1].data(), decoder[2].data(), decoder[3].data()};
  const std::array<const Complex*, 4> value = {pair[0].data(), mirrored[0].data(), pair[1].data(), mirrored[1].data()};
  for (std::size_t term = 0; term < 4; term += 2) {
    const Complex *a = factor[term], *b = factor[term + 1], *x = value[term], *y = value[term + 1];
    if (term == 0)
      for (std::size_t k = 0; k < ears.size(); ++k) sum[k] = multiply(a[k], x[k]) + multiply(b[k], y[k]);
    else
      for (std::size_t k = 0; k < ears.size(); ++k) sum[k] += multiply(a[k], x[k]) + multiply(b[k], y[k]);
  }
}

void add_ears(const Complex* ears, std::size_t count, float* __restrict left, float* __restrict right) {
  for (std::size_t i = 0; i < count; ++i) {
    left[i] += ears[i].real();
    right[i] += ears[i].imag();
  }
}

}  // namespace

struct RirSynthesizer::Scratch {
  explicit Scratch(const SynthesisTables& tables)
      : early_fft(tables.early_fft),
        place(tables.num_samples, tables.carriers, tables.seed),
        bands(tables.filters),
        response(static_cast<std::size_t>(tables.early_fft)),
        rotation(tables.layout.kind == ListenerKind::ambisonics ? tables.layout.order : 1) {
    for (auto& spectrum : ear) spectrum.resize(tables.filters.num_bins());
    if (tables.layout.kind == ListenerKind::ambisonics) {
      harmonics.resize(static_cast<std::size_t>(tables.layout.num_channels()));
      channels.resize(harmonics.size());
    }
    if (tables.has_plane_waves) array.emplace(tables.bands, tables.sample_rate_hz, tables.num_samples, tables.layout.microphones);
    if (!tables.hrtf) return;
    late_forward.emplace(tables.late_fft, ComplexFft::Direction::forward);
    late_inverse.emplace(tables.late_fft, ComplexFft::Direction::inverse);
    for (auto& channel : field) channel.resize(static_cast<std::size_t>(tables.num_samples));
    for (auto* spectra : {&pair_spectrum, &mirrored})
      for (auto& spectrum : *spectra) spectrum.resize(static_cast<std::size_t>(tables.late_fft));
  }

  RealFft early_fft;
  LateEnvelope envelope;
  LateSynthesizer late;
  LateCarriers place;
  std::vector<float> energy_before;
  ArrivalSpectrum bands;        ///< of one arrival
  std::vector<float> response;  ///< of one arrival in one channel
  std::array<std::vector<Complex>, 2> ear;
  HarmonicRotation rotation;
  // binaural
  BinauralLateTail late_tail;
  LateSound sound;                          ///< of callers that keep none
  std::array<std::vector<float>, 4> field;  ///< the same in head axes
  std::optional<ComplexFft> late_forward, late_inverse;
  std::array<AlignedSpectrum, 2> pair_spectrum, mirrored;  ///< Z and Z~ of SynthesisTables::decoder
  // ambisonics
  std::vector<float> block;
  std::vector<float> harmonics;
  std::vector<std::span<float>> channels;
  // array
  std::optional<LateArray> array;
};

/// Arguments of one render call.
struct RirSynthesizer::Pass {
  const EnergyResponse& response;
  const ListenerOrientation& orientation;
  const CarrierKey& key;
  double samples_per_m;
  LateSound* cached;
};

RirSynthesizer::RirSynthesizer(std::shared_ptr<const SynthesisTables> tables)
    : tables_(std::move(tables)), scratch_(std::make_unique<Scratch>(*tables_)) {}
RirSynthesizer::~RirSynthesizer() = default;
RirSynthesizer::RirSynthesizer(RirSynthesizer&&) noexcept = default;

/// Adds the impulse that scratch_->bands describes to one channel.
void RirSynthesizer::add_impulse(double delay_samples, std::size_t channel, Rir& rir) {
  Scratch& scratch = *scratch_;
  const auto length = static_cast<std::size_t>(rir.num_samples);
  const auto samples = std::span(rir.samples).subspan(channel * length, length);
  const SplitDelay delay(delay_samples);
  if (scratch.bands.flat() && delay.part == 0) {
    if (delay.whole >= 0 && delay.whole < rir.num_samples) samples[static_cast<std::size_t>(delay.whole)] += scratch.bands.factor();
    return;
  }
  std::fill(scratch.ear[0].begin(), scratch.ear[0].end(), Complex(1.f));
  delay_spectrum(scratch.ear[0], delay.part, tables_->early_fft);
  scratch.bands.apply(scratch.ear[0]);
  scratch.early_fft.inverse(scratch.ear[0], scratch.response);
  add_circular(scratch.response, 0, delay.whole, samples);
}

void RirSynthesizer::add_to_ears(const Pass& pass, const Arrival& arrival, double delay_samples, Rir& rir) {
  const SynthesisTables& tables = *tables_;
  Scratch& scratch = *scratch_;
  const SplitDelay delay(delay_samples);
  const auto length = static_cast<std::size_t>(rir.num_samples);
  tables.hrtf->spectra(pass.orientation.world_to_local(arrival.direction), scratch.ear[0], scratch.ear[1], delay.part,
                       static_cast<double>(arrival.distance_m));
  for (std::size_t ear = 0; ear < 2; ++ear) {
    scratch.bands.apply(scratch.ear[ear]);
    scratch.early_fft.inverse(scratch.ear[ear], scratch.response);
    add_circular(scratch.response, tables.hrtf->lead_samples(), delay.whole, std::span(rir.samples).subspan(ear * length, length));
  }
}

/// One impulse, weighted with the harmonics of its direction.
void RirSynthesizer::add_to_harmonics(const Pass& pass, const Arrival& arrival, double delay_samples, Rir& rir) {
  Scratch& scratch = *scratch_;
  const ListenerLayout& layout = tables_->layout;
  const glm::vec3 from = layout.axes == HarmonicAxes::ego ? pass.orientation.world_to_local(arrival.direction) : arrival.direction;
  spherical_harmonics_n3d(from, layout.order, scratch.harmonics);
  const auto length = static_cast<std::size_t>(rir.num_samples);
  const SplitDelay delay(delay_samples);
  if (scratch.bands.flat() && delay.part == 0) {
    if (delay.whole >= rir.num_samples) return;
    for (std::size_t c = 0; c < scratch.harmonics.size(); ++c)
      rir.samples[c * length + static_cast<std::size_t>(delay.whole)] += scratch.bands.factor() * scratch.harmonics[c];
    return;
  }
  std::fill(scratch.ear[0].begin(), scratch.ear[0].end(), Complex(1.f));
  delay_spectrum(scratch.ear[0], delay.part, tables_->early_fft);
  scratch.bands.apply(scratch.ear[0]);
  scratch.early_fft.inverse(scratch.ear[0], scratch.response);
  scratch.block.resize(scratch.response.size());
  for (std::size_t c = 0; c < scratch.harmonics.size(); ++c) {
    for (std::size_t n = 0; n < scratch.response.size(); ++n) scratch.block[n] = scratch.harmonics[c] * scratch.response[n];
    add_circular(scratch.block, 0, delay.whole, std::span(rir.samples).subspan(c * length, length));
  }
}

void RirSynthesizer::add_to_microphones(const Pass& pass, const Arrival& arrival, Rir& rir) {
  const SynthesisTables& tables = *tables_;
  for (std::size_t i = 0; i < tables.layout.microphones.size(); ++i) {
    const MicrophoneWave wave(tables, i, arrival, pass.orientation);
    scratch_->bands.set(wave.amplitude(), wave.phase_rad(), static_cast<double>(arrival.distance_m));
    if (scratch_->bands.silent()) continue;
    const double delay = wave.distance_m() * pass.samples_per_m;
    if (delay > -tables.early_fft && delay < rir.num_samples + tables.early_fft / 2) add_impulse(delay, i, rir);
  }
}

void RirSynthesizer::add_arrival(const Pass& pass, const Arrival& arrival, Rir& rir) {
  const SynthesisTables& tables = *tables_;
  const double delay_samples = static_cast<double>(arrival.distance_m) * pass.samples_per_m;
  if (tables.layout.kind == ListenerKind::array) return add_to_microphones(pass, arrival, rir);
  if (!(delay_samples >= 0 && delay_samples < rir.num_samples + tables.early_fft / 2)) return;
  const auto num_bands = static_cast<std::size_t>(tables.num_bands);
  scratch_->bands.set(std::span(arrival.amplitude).first(num_bands), std::span(arrival.phase_rad).first(num_bands),
                      static_cast<double>(arrival.distance_m));
  if (scratch_->bands.silent()) return;
  if (tables.layout.kind == ListenerKind::mono) add_impulse(delay_samples, 0, rir);
  if (tables.layout.kind == ListenerKind::binaural) add_to_ears(pass, arrival, delay_samples, rir);
  if (tables.layout.kind == ListenerKind::ambisonics) add_to_harmonics(pass, arrival, delay_samples, rir);
}

/// World to head axes for the decoder.
RirSynthesizer::FirstOrder RirSynthesizer::rotate_first_order(const ListenerOrientation& orientation, const LateSound& sound) {
  Scratch& scratch = *scratch_;
  const std::size_t num_samples = sound.sounding_;
  const auto sounding = [&](const std::vector<float>& channel) { return std::span(channel).first(num_samples); };
  if (!orientation.level()) {
    for (std::size_t c = 0; c < 4; ++c) std::copy_n(sound.channels_[c].begin(), num_samples, scratch.field[c].begin());
    const std::array<std::span<float>, 4> channels = {scratch.field[0], scratch.field[1], scratch.field[2], scratch.field[3]};
    scratch.rotation.set(orientation);
    scratch.rotation.apply(channels, num_samples);
    return {sounding(scratch.field[0]), sounding(scratch.field[1]), sounding(scratch.field[2]), sounding(scratch.field[3])};
  }
  // A turn about the vertical mixes the two horizontal dipoles only (rotate_to_heading for whole signals).
  const auto cosine = static_cast<float>(std::cos(orientation.heading_rad())),
             sine = static_cast<float>(std::sin(orientation.heading_rad()));
  const float *side = sound.channels_[1].data(), *front = sound.channels_[3].data();
  float* __restrict turned_side = scratch.field[1].data(), * __restrict turned_front = scratch.field[3].data();
  for (std::size_t n = 0; n < num_samples; ++n) {
    const float s = side[n], f = front[n];
    turned_side[n] = cosine * s - sine * f;
    turned_front[n] = cosine * f + sine * s;
  }
  return {sounding(sound.channels_[0]), sounding(scratch.field[1]), sounding(sound.channels_[2]), sounding(scratch.field[3])};
}

/// Late sound at the ears: N3D channels in head axes through the decoder, by overlap-add.
void RirSynthesizer::decode_late(const FirstOrder& field, Rir& rir) {
  const std::size_t num_samples = field[0].size();
  const SynthesisTables& tables = *tables_;
  Scratch& scratch = *scratch_;
  const auto length = static_cast<std::size_t>(rir.num_samples), lead = static_cast<std::size_t>(tables.hrtf->lead_samples());
  const auto step = static_cast<std::size_t>(tables.late_fft - tables.hrtf->decoder_taps() + 1);
  for (std::size_t begin = 0; begin < num_samples; begin += step) {
    const std::size_t count = std::min(step, num_samples - begin);
    for (std::size_t pair = 0; pair < 2; ++pair) {
      const auto segment = [&](std::size_t c) { return field[c].subspan(begin, count); };
      scratch.late_forward->set_input(segment(2 * pair), segment(2 * pair + 1));
      scratch.late_forward->transform(scratch.pair_spectrum[pair]);
      mirror(scratch.pair_spectrum[pair], scratch.mirrored[pair]);
    }
    decode(tables.decoder, scratch.pair_spectrum, scratch.mirrored, scratch.late_inverse->input());
    const Complex* block = scratch.late_inverse->transform().data();
    // Block sample i belongs at begin + i - lead: the decoder starts that much before time zero.
    const std::size_t used = count + static_cast<std::size_t>(tables.hrtf->decoder_taps()) - 1;
    const std::size_t first = lead > begin ? lead - begin : 0, end = std::min(used, length + lead - begin);
    if (end > first) add_ears(block + first, end - first, &rir.samples[begin + first - lead], &rir.samples[length + begin + first - lead]);
  }
}

/// Late sound as first-order harmonics in world axes, from the cache if it is there: for ears up to where the binaural tail begins.
const LateSound& RirSynthesizer::first_order_sound(const Pass& pass, double onset_sample, std::size_t length) {
  const SynthesisTables& tables = *tables_;
  Scratch& scratch = *scratch_;
  LateSound& sound = pass.cached != nullptr ? *pass.cached : scratch.sound;
  if (sound.known_ && pass.cached != nullptr) return sound;
  for (auto& channel : sound.channels_) channel.resize(static_cast<std::size_t>(tables.num_samples));
  const auto channel = [&](std::size_t c) { return std::span(sound.channels_[c]).first(length); };
  const std::array<std::span<float>, 4> channels = {channel(0), channel(1), channel(2), channel(3)};
  sound.envelope_.make(pass.response.late, tables.sample_rate_hz, onset_sample, length);
  sound.num_decoded_ = tables.layout.kind == ListenerKind::binaural
                           ? bins_to_decode(sound.envelope_, tables.late_decode_samples, scratch.energy_before)
                           : sound.envelope_.size();
  scratch.place.set(pass.key, kFieldStream, sound.envelope_);
  sound.sounding_ = scratch.late.render(sound.envelope_, sound.num_decoded_, tables.carriers, scratch.place, channels);
  sound.known_ = true;
  return sound;
}

/// Late sound at first-order microphones in one place: a + (1 - a) cos is a sum of the four harmonics.
void RirSynthesizer::mix_late(const LateSound& sound, const ListenerOrientation& orientation, Rir& rir) {
  const auto length = static_cast<std::size_t>(rir.num_samples);
  for (std::size_t i = 0; i < tables_->layout.microphones.size(); ++i) {
    const Microphone& microphone = tables_->layout.microphones[i];
    const float omni_weight = *microphone.omni_weight();
    std::array<float, 4> weight;
    spherical_harmonics_n3d(glm::normalize(orientation.local_to_world(microphone.orientation * glm::vec3(0, 0, -1))), 1, weight);
    weight[0] = omni_weight;
    for (std::size_t c = 1; c < 4; ++c) weight[c] *= (1.f - omni_weight) / 3.f;  // the harmonics of two directions: 3 cos
    const std::array<const float*, 4> in = {sound.channels_[0].data(), sound.channels_[1].data(), sound.channels_[2].data(),
                                            sound.channels_[3].data()};
    float* __restrict out = rir.samples.data() + i * length;
    for (std::size_t n = 0; n < sound.sounding_; ++n)
      out[n] += weight[0] * in[0][n] + weight[1] * in[1][n] + weight[2] * in[2][n] + weight[3] * in[3][n];
  }
}

void RirSynthesizer::render_late(const Pass& pass, double onset_sample, Rir& rir) {
  const SynthesisTables& tables = *tables_;
  Scratch& scratch = *scratch_;
  const EnergyHistogram& late = pass.response.late;
  if (late.num_bins() == 0) return;
  const auto length = static_cast<std::size_t>(rir.num_samples);
  switch (tables.layout.kind) {
    case ListenerKind::mono: {
      const std::array<std::span<float>, 1> channels = {std::span(rir.samples)};
      scratch.envelope.make(late, tables.sample_rate_hz, onset_sample, length);
      scratch.place.set(pass.key, kFieldStream, scratch.envelope);
      scratch.late.render(scratch.envelope, scratch.envelope.size(), tables.carriers, scratch.place, channels);
      return;
    }
    case ListenerKind::binaural: {
      const LateSound& sound = first_order_sound(pass, onset_sample, length);
      decode_late(rotate_first_order(pass.orientation, sound), rir);
      if (sound.num_decoded_ == sound.envelope_.size()) return;
      // Further on in the same loops: the parts that fade out and in must be independent, or powers would not add.
      scratch.place.set(pass.key, kFieldStream, sound.envelope_, scratch.place.apart());
      scratch.late_tail.add(sound.envelope_, sound.num_decoded_, tables.binaural_noise, scratch.place, pass.orientation,
                            std::span(rir.samples).first(length), std::span(rir.samples).subspan(length));
      return;
    }
    case ListenerKind::ambisonics: {
      for (std::size_t c = 0; c < scratch.channels.size(); ++c) scratch.channels[c] = std::span(rir.samples).subspan(c * length, length);
      scratch.envelope.make(late, tables.sample_rate_hz, onset_sample, length);
      scratch.place.set(pass.key, kFieldStream, scratch.envelope);
      const std::size_t sounding =
          scratch.late.render(scratch.envelope, scratch.envelope.size(), tables.carriers, scratch.place, scratch.channels);
      if (tables.layout.axes == HarmonicAxes::world) return;
      scratch.rotation.set(pass.orientation);
      scratch.rotation.apply(scratch.channels, sounding);
      return;
    }
    case ListenerKind::array:
      if (!tables.has_plane_waves) return mix_late(first_order_sound(pass, onset_sample, length), pass.orientation, rir);
      scratch.array->render({.energy = late,
                             .onset_sample = onset_sample,
                             .key = pass.key,
                             .orientation = pass.orientation,
                             .speed_of_sound_m_per_s = pass.response.speed_of_sound_m_per_s},
                            tables.carriers, scratch.place, tables.patterns, rir.samples);
  }
}

int RirSynthesizer::count_samples(const EnergyHistogram& late) const {
  const SynthesisTables& tables = *tables_;
  if (late.num_bins() == 0 || tables.has_plane_waves) return tables.num_samples;
  const double bin_samples = static_cast<double>(late.bin_s()) * static_cast<double>(tables.sample_rate_hz);
  const double samples = static_cast<double>(late.num_bins()) * bin_samples;
  if (samples > tables.num_samples - bin_samples) return tables.num_samples;
  return std::max(1, static_cast<int>(std::lround(samples)));
}

void RirSynthesizer::render(const EnergyResponse& response, const ListenerOrientation& orientation, const CarrierKey& key, Rir& rir,
                            LateSound* cached, std::span<const std::uint8_t> left_out) {
  const FlushDenormals flush;
  const SynthesisTables& tables = *tables_;
  require(response.late.num_bins() == 0 || response.late.num_bands() == tables.num_bands, "bands of the response",
          response.late.num_bands(), "must match the tables");
  const bool needs_speed = !response.arrivals.empty() || tables.layout.kind == ListenerKind::array;
  require(!needs_speed || response.speed_of_sound_m_per_s > 0, "speed of sound", response.speed_of_sound_m_per_s,
          "must be set with the response");
  rir.num_channels = tables.layout.num_channels();
  rir.num_samples = count_samples(response.late);
  rir.sample_rate_hz = tables.sample_rate_hz;
  rir.channel_mask = tables.layout.channel_mask;
  rir.samples.assign(static_cast<std::size_t>(rir.num_channels) * static_cast<std::size_t>(rir.num_samples), 0.f);
  const double samples_per_m =
      needs_speed ? static_cast<double>(tables.sample_rate_hz) / static_cast<double>(response.speed_of_sound_m_per_s) : 0.0;
  const Pass pass{response, orientation, key, samples_per_m, cached};

  // Nothing is heard before a direct sound.
  double onset_sample = 0;
  for (const Arrival& arrival : response.arrivals)
    if (arrival.kind == ArrivalKind::direct)
      onset_sample = std::clamp(static_cast<double>(arrival.distance_m) * pass.samples_per_m, 0.0, static_cast<double>(rir.num_samples));
  render_late(pass, onset_sample, rir);
  scratch_->bands.set_air(response.air);
  EARSHOT_EXPECT(left_out.empty() || left_out.size() == response.arrivals.size());
  for (std::size_t i = 0; i < response.arrivals.size(); ++i)
    if (left_out.empty() || left_out[i] == 0) add_arrival(pass, response.arrivals[i], rir);
  for (std::size_t c = 0; c < tables.low_passes.size(); ++c) {
    const auto length = static_cast<std::size_t>(rir.num_samples);
    if (tables.low_passes[c]) tables.low_passes[c]->filter(std::span(rir.samples).subspan(c * length, length));
  }
  if (tables.layout.kind != ListenerKind::ambisonics || tables.layout.norm == HarmonicNorm::n3d) return;
  for (int c = 1; c < rir.num_channels; ++c) {
    const float factor = sn3d_from_n3d(c);
    for (std::size_t n = 0; n < static_cast<std::size_t>(rir.num_samples); ++n)
      rir.samples[static_cast<std::size_t>(c) * static_cast<std::size_t>(rir.num_samples) + n] *= factor;
  }
}

}  // namespace earshot
