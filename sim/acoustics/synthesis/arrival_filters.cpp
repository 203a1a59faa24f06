// SPDX-License-Identifier: Apache-2.0
#include "sim/acoustics/synthesis/arrival_filters.h"

#include <algorithm>
#include <array>
#include <glm/geometric.hpp>

#include "sim/acoustics/synthesis/microphone_wave.h"
#include "sim/acoustics/synthesis/synthesis_tables.h"
#include "sim/audio/head/ambisonics.h"
#include "sim/base/errors.h"

namespace earshot {
namespace {

using Complex = std::complex<float>;

}  // namespace

ArrivalFilters::ArrivalFilters(std::shared_ptr<const SynthesisTables> tables)
    : tables_(std::move(tables)),
      fft_(tables_->early_fft),
      bands_(tables_->filters),
      response_(static_cast<std::size_t>(tables_->early_fft)) {
  for (auto& spectrum : spectrum_) spectrum.resize(tables_->filters.num_bins());
  if (tables_->layout.kind == ListenerKind::ambisonics) harmonics_.resize(static_cast<std::size_t>(tables_->layout.num_channels()));
  for (const std::optional<LowPass>& low_pass : tables_->low_passes) {
    std::vector<Complex>& spectrum = low_pass_spectrum_.emplace_back();
    if (!low_pass) continue;
    const double bin_hz = static_cast<double>(tables_->sample_rate_hz) / tables_->early_fft;
    for (std::size_t k = 0; k < tables_->filters.num_bins(); ++k)
      spectrum.emplace_back(low_pass->response(static_cast<double>(k) * bin_hz));
  }
}

int ArrivalFilters::num_channels() const { return tables_->layout.num_channels(); }
int ArrivalFilters::num_taps() const { return tables_->early_fft; }

bool ArrivalFilters::make(const Arrival& arrival, const ListenerOrientation& orientation, float speed_of_sound_m_per_s,
                          std::span<double> delay_samples, std::span<float> taps) {
  const SynthesisTables& tables = *tables_;
  EARSHOT_EXPECT(delay_samples.size() == static_cast<std::size_t>(num_channels()));
  EARSHOT_EXPECT(taps.size() == delay_samples.size() * static_cast<std::size_t>(num_taps()) && speed_of_sound_m_per_s > 0);
  const auto num_bands = static_cast<std::size_t>(tables.num_bands);
  bands_.set(std::span(arrival.amplitude).first(num_bands), std::span(arrival.phase_rad).first(num_bands),
             static_cast<double>(arrival.distance_m));
  if (bands_.silent()) return false;
  const double samples_per_m = static_cast<double>(tables.sample_rate_hz) / static_cast<double>(speed_of_sound_m_per_s);
  std::ranges::fill(delay_samples, static_cast<double>(arrival.distance_m) * samples_per_m);
  switch (tables.layout.kind) {
    case ListenerKind::binaural:
      to_ears(arrival, orientation, delay_samples, taps);
      break;
    case ListenerKind::array:
      to_microphones(arrival, orientation, samples_per_m, delay_samples, taps);
      break;
    case ListenerKind::mono:
    case ListenerKind::ambisonics:
      to_harmonics(arrival, orientation, taps);
  }
  return true;
}

/// The response [num_taps], times `factor`, with its middle where it has its beginning.
void ArrivalFilters::write_taps(std::size_t channel, float factor, std::span<float> taps) {
  const std::size_t size = response_.size(), half = size / 2;
  float* out = taps.data() + channel * size;
  for (std::size_t i = 0; i < half; ++i) {
    out[half + i] = factor * response_[i];
    out[i] = factor * response_[half + i];
  }
}

void ArrivalFilters::to_ears(const Arrival& arrival, const ListenerOrientation& orientation, std::span<double> delay_samples,
                             std::span<float> taps) {
  const std::array<double, 2> ear_delay = tables_->hrtf->aligned_spectra(orientation.world_to_local(arrival.direction), spectrum_[0],
                                                                         spectrum_[1], static_cast<double>(arrival.distance_m));
  for (std::size_t ear = 0; ear < 2; ++ear) {
    bands_.apply(spectrum_[ear]);
    fft_.inverse(spectrum_[ear], response_);
    write_taps(ear, 1.f, taps);
    delay_samples[ear] += ear_delay[ear];
  }
}

/// One channel without a direction, or one for each harmonic of it.
void ArrivalFilters::to_harmonics(const Arrival& arrival, const ListenerOrientation& orientation, std::span<float> taps) {
  const ListenerLayout& layout = tables_->layout;
  std::ranges::fill(spectrum_[0], Complex(1.f));
  bands_.apply(spectrum_[0]);
  fft_.inverse(spectrum_[0], response_);
  if (layout.kind == ListenerKind::mono) return write_taps(0, 1.f, taps);
  const glm::vec3 from = layout.axes == HarmonicAxes::ego ? orientation.world_to_local(arrival.direction) : arrival.direction;
  spherical_harmonics_n3d(from, layout.order, harmonics_);
  for (std::size_t c = 0; c < harmonics_.size(); ++c)
    write_taps(c, layout.norm == HarmonicNorm::n3d ? harmonics_[c] : harmonics_[c] * sn3d_from_n3d(static_cast<int>(c)), taps);
}

void ArrivalFilters::to_microphones(const Arrival& arrival, const ListenerOrientation& orientation, double samples_per_m,
                                    std::span<double> delay_samples, std::span<float> taps) {
  for (std::size_t i = 0; i < tables_->layout.microphones.size(); ++i) {
    const MicrophoneWave wave(*tables_, i, arrival, orientation);
    bands_.set(wave.amplitude(), wave.phase_rad(), static_cast<double>(arrival.distance_m));
    if (tables_->low_passes.empty() || !tables_->low_passes[i])
      std::ranges::fill(spectrum_[0], Complex(1.f));
    else
      std::ranges::copy(low_pass_spectrum_[i], spectrum_[0].begin());
    bands_.apply(spectrum_[0]);
    fft_.inverse(spectrum_[0], response_);
    write_taps(i, 1.f, taps);
    delay_samples[i] = wave.distance_m() * samples_per_m;
  }
}

}  // namespace earshot
