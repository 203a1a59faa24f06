// SPDX-License-Identifier: Apache-2.0
#include "envs/hearing/agent_hearing.h"

#include <algorithm>

#include "envs/hearing/finite_values.h"
#include "sim/base/random.h"

namespace earshot {
namespace {

/// Appends [channels, n] to the end of a rolling [channels, samples], dropping the oldest.
void push(std::span<const float> sound, std::size_t num_channels, std::span<float> window) {
  const std::size_t n = sound.size() / num_channels, samples = window.size() / num_channels;
  for (std::size_t channel = 0; channel < num_channels; ++channel) {
    const auto row = window.subspan(channel * samples, samples);
    std::copy(row.begin() + static_cast<std::ptrdiff_t>(n), row.end(), row.begin());
    std::copy_n(sound.begin() + static_cast<std::ptrdiff_t>(channel * n), n, row.end() - static_cast<std::ptrdiff_t>(n));
  }
}

}  // namespace

void AgentHearing::begin(std::span<const PlayedSound> played, const BackgroundNoise& noise) {
  if (sources_.size() < played.size()) sources_.resize(played.size());
  for (std::size_t i = 0; i < played.size(); ++i) sources_[i].begin(played[i]);
  sounding_.assign(played.size(), 0);
  noise_ = noise;
  sample_ = 0;
  history_.forget();
  interaural_history_.forget();
  new_samples_ = 0;
}

void AgentHearing::trace(const HearingEngines& engines, const Pose& pose, float ear_height_m, int block) {
  for (std::size_t i = 0; i < sounding_.size(); ++i) {
    sounding_[i] = sources_[i].sounds(engines, block) ? 1 : 0;
    if (sounding_[i] != 0) sources_[i].trace(pose, ear_height_m, sounding_.size() > 2 ? &memory_ : nullptr);
  }
}

bool AgentHearing::synthesize(HearingEngines& engines, double heading_rad, const std::function<void(std::span<float> rir)>& hook) {
  for (std::size_t i = 0; i < sounding_.size(); ++i)
    if (sounding_[i] != 0 && !sources_[i].synthesize(engines, heading_rad, hook)) return false;
  return true;
}

bool AgentHearing::convolve(HearingEngines& engines, int block, std::span<float> sound, std::span<float> window) {
  bool first = true;
  for (std::size_t i = 0; i < sounding_.size(); ++i) {
    if (sounding_[i] == 0) {
      sources_[i].pass(block);
    } else if (first) {
      sources_[i].convolve(engines, block, sound);
      first = false;
    } else {
      const auto part = std::span(engines.part).first(sound.size());
      sources_[i].convolve(engines, block, part);
      for (std::size_t sample = 0; sample < sound.size(); ++sample) sound[sample] += part[sample];
    }
  }
  if (first) std::fill(sound.begin(), sound.end(), 0.f);
  if (noise_.rms > 0) add_noise(sound, engines.num_channels);
  sample_ += static_cast<std::uint64_t>(block);
  const bool finite = all_finite(sound);
  if (!finite) std::fill(sound.begin(), sound.end(), 0.f);
  push(sound, engines.num_channels, window);
  new_samples_ += static_cast<std::size_t>(block);
  return finite;
}

/// Normal numbers as a function of the stream sample: a replay from the middle has the same.
void AgentHearing::add_noise(std::span<float> sound, std::size_t num_channels) const {
  const std::size_t block = sound.size() / num_channels;
  for (std::size_t channel = 0; channel < num_channels; ++channel) {
    // After the offsets of sounds, which are draws of (stream, episode, 0).
    const RandomStream random(noise_.seed, Purpose::sound, noise_.stream, noise_.episode,
                              static_cast<std::uint32_t>(1 + num_channels * noise_.agent + channel));
    for (std::size_t i = 0; i < block; ++i)  // one of a pair, so that a sample depends on its place alone
      sound[channel * block + i] += noise_.rms * random.normal2(static_cast<std::uint32_t>(sample_ + i))[0];
  }
}

void AgentHearing::analyze(HearingEngines& engines, std::span<const float> window, std::span<float> spectrogram,
                           std::span<float> interaural) {
  if (!spectrogram.empty()) engines.analyzer.analyze(window, new_samples_, history_, spectrogram);
  if (!interaural.empty()) engines.interaural.analyze(window, new_samples_, interaural_history_, interaural);
  new_samples_ = 0;
}

bool AgentHearing::fill_window(HearingEngines& engines, int block, std::span<float> sound, std::span<float> window) {
  const auto samples = static_cast<int>(window.size() / engines.num_channels);
  bool finite = true;
  // The odd piece first, so that the last call leaves whole block in `sound`.
  if (const int odd = samples % block; odd > 0)
    finite = convolve(engines, odd, std::span(engines.block).first(engines.num_channels * static_cast<std::size_t>(odd)), window);
  for (int piece = 0; piece < samples / block; ++piece) finite = convolve(engines, block, sound, window) && finite;
  return finite;
}

void AgentHearing::seek(std::uint64_t sample) {
  for (std::size_t i = 0; i < sounding_.size(); ++i) sources_[i].seek(sample);
  sample_ = sample;
}

EffectCounters AgentHearing::effects() const {
  EffectCounters sum;
  for (const SourceHearing& source : sources_) sum.add(source.effects());
  return sum;
}

std::uint64_t AgentHearing::cached_responses() const {
  std::uint64_t sum = 0;
  for (const SourceHearing& source : sources_) sum += source.cached_responses();
  return sum;
}

}  // namespace earshot
