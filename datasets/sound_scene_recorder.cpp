// SPDX-License-Identifier: Apache-2.0
#include "datasets/sound_scene_recorder.h"

#include <algorithm>
#include <cmath>
#include <utility>

#include "datasets/corpus_sounds.h"
#include "sim/acoustics/response/retarded_source.h"
#include "sim/acoustics/source_field/source_field.h"
#include "sim/acoustics/synthesis/carriers.h"
#include "sim/acoustics/synthesis/synthesis_tables.h"
#include "sim/base/errors.h"

namespace earshot {
namespace {

double energy_of_loop(const SoundClip& clip, std::size_t sounding) {
  double sum = 0;
  for (std::size_t i = 0; i < sounding; ++i) {
    const auto sample = static_cast<double>(clip.samples[i % clip.samples.size()]);
    sum += sample * sample;
  }
  return sum;
}

/// Of the sound before its loudest sample, where it begins there.
constexpr double kLeadS = 0.005;

/// The sound of an event, which loops, and the sample of its file with which it begins.
struct StartedSound {
  SoundClip clip;
  std::uint64_t start = 0;
};

/// At the level that was drawn while it sounds.  One that begins with a silence as long as the event begins shortly before its loudest
/// sample instead.
StartedSound levelled(const SoundEvent& event, float sample_rate_hz, std::size_t sounding) {
  SoundClip clip = open_sound(event.sound, sample_rate_hz);
  std::uint64_t start = 0;
  double sum = energy_of_loop(clip, sounding);
  if (sum <= 0) {
    const auto lead = std::min(static_cast<std::size_t>(std::lround(kLeadS * static_cast<double>(sample_rate_hz))), sounding / 2);
    start = sounding_start(clip.samples, 0, 0, sounding, lead);
    std::ranges::rotate(clip.samples, clip.samples.begin() + static_cast<std::ptrdiff_t>(start));
    sum = energy_of_loop(clip, sounding);
  }
  if (sum <= 0) throw InputError(event.sound, "is silent", "remove it from its class");
  const auto factor = static_cast<float>(std::pow(10, event.level_db / 20) / std::sqrt(sum / static_cast<double>(sounding)));
  for (float& sample : clip.samples) sample *= factor;
  return {.clip = std::move(clip), .start = start};
}

/// Adds `block` [channels, n] to the recording from frame `first` on.
void add_block(std::span<const float> block, std::size_t channels, std::size_t first, const RecordingMix& mix) {
  const std::size_t width = block.size() / channels, count = first >= mix.frames ? 0 : std::min(width, mix.frames - first);
  for (std::size_t c = 0; c < channels; ++c)
    for (std::size_t n = 0; n < count; ++n) mix.samples[c * mix.frames + first + n] += block[c * width + n];
}

/// By the place, so that events add up; one that moves by where it begins.
std::uint64_t noise_key(const PlacedEvent& placed) { return carrier_key(placed.room.acoustics().hash(), placed.event.path[0].position); }

}  // namespace

SoundSceneRecorder::SoundSceneRecorder(const SoundSceneConfig& config, std::shared_ptr<const SynthesisTables> tables)
    : config_(config),
      num_channels_(tables->layout.num_channels()),
      block_(std::max(1, static_cast<int>(std::lround(kStepS * static_cast<double>(config.rooms.acoustics.sample_rate_hz))))),
      synthesizer_(tables),
      glider_(tables, block_) {}

std::uint64_t SoundSceneRecorder::add(const PlacedEvent& placed, const RecordingMix& mix) {
  const SoundEvent& event = placed.event;
  const auto rate_hz = static_cast<double>(config_.rooms.acoustics.sample_rate_hz);
  const auto first = static_cast<std::size_t>(std::lround(event.onset_s * rate_hz));
  const auto sounding = static_cast<std::size_t>(std::lround((event.offset_s - event.onset_s) * rate_hz));
  const auto [clip, start] = levelled(event, config_.rooms.acoustics.sample_rate_hz, sounding);
  const DrySound dry{.clip = clip, .first = first, .sounding = sounding};
  if (event.moves())
    add_moving(placed, dry, mix);
  else
    add_resting(placed, dry, mix);
  return start;
}

void SoundSceneRecorder::add_resting(const PlacedEvent& placed, const DrySound& dry, const RecordingMix& mix) {
  SoundSource source = placed.source;
  source.position = placed.event.path[0].position;
  const glm::vec3 listener = placed.listener.position;
  const AcousticScene& acoustics = placed.room.acoustics();
  const EarlyCandidates candidates(acoustics, source);
  std::shared_ptr<const SourceField> field;
  if (acoustics.config().field == Switch::on && uses_source_field(acoustics)) field = build_source_field(acoustics, candidates);
  compute_energy_response(acoustics, candidates, field.get(), listener, response_);
  Rir rir;
  synthesizer_.render(response_, placed.listener.orientation(), CarrierKey(noise_key(placed), listener), rir);
  std::vector<float> sound(dry.sounding);
  for (std::size_t i = 0; i < sound.size(); ++i) sound[i] = dry.clip.samples[i % dry.clip.samples.size()];
  add_block(fir_.convolve(sound, rir.samples, rir.num_channels), static_cast<std::size_t>(num_channels_), dry.first, mix);
}

void SoundSceneRecorder::add_moving(const PlacedEvent& placed, const DrySound& dry, const RecordingMix& mix) {
  const AcousticScene& acoustics = placed.room.acoustics();
  const AcousticConfig& config = acoustics.config();
  const auto rate_hz = static_cast<double>(config.sample_rate_hz);
  const OversampledSound oversampled(dry.clip);
  const glm::vec3 listener = placed.listener.position;
  const ListenerOrientation orientation = placed.listener.orientation();
  SoundSource source = placed.source;
  StreamPosition position{.sample = 0, .clip_offset = 0, .already_playing = false, .begin = 0, .end = dry.sounding};
  TemporalReuse reuse;
  const bool reuses = config.temporal_reuse != Switch::off && config.source_rays == 0 && config.specular_exponent == 0.f;
  GlidingPaths gliding;
  Rir rir, previous;
  std::vector<float> part(static_cast<std::size_t>(block_) * static_cast<std::size_t>(num_channels_));
  const double ring_s = 2 * static_cast<double>(config.rir_length_s);
  const auto end = std::min(mix.frames, dry.first + dry.sounding + static_cast<std::size_t>(ring_s * rate_hz));
  const SourcePlaceAt place = [&](double since_onset_s) { return glm::dvec3(placed.event.position_at(since_onset_s)); };
  const std::uint64_t noise = noise_key(placed);
  const auto hear = [&](double since_onset_s) {
    const double emitted_s = emission_time_s(place, listener, since_onset_s, double{acoustics.speed_of_sound_m_per_s()});
    source.position = placed.event.position_at(emitted_s);
    const EarlyCandidates candidates(acoustics, source, SourceMotion::moves);
    if (reuses)
      reuse.compute(acoustics, candidates, listener, response_);
    else
      compute_energy_response(acoustics, candidates, nullptr, listener, response_);
    retard_arrivals(place, emitted_s, since_onset_s, response_);
    const std::span<const std::uint8_t> glides = glider_.choose(response_, &gliding);
    synthesizer_.render(response_, orientation, {noise, listener, std::optional(source.position)}, rir, nullptr, glides);
    glider_.advance(response_, glides, orientation, gliding);
  };
  hear(0);
  for (std::size_t at = dry.first; at < end; at += static_cast<std::size_t>(block_)) {
    // Each block leads from where the one before has ended to where it ends.
    std::swap(rir, previous);
    hear(static_cast<double>(at - dry.first + static_cast<std::size_t>(block_)) / rate_hz);
    if (!stream_) stream_.emplace(StreamConfig{rir.sample_rate_hz, rir.num_samples, block_, block_}, rir.num_channels);
    stream_->convolve(dry.clip, position, rir.samples, previous.samples, rir.num_samples, block_, part);
    glider_.render(oversampled, position, block_, block_, gliding, part);
    add_block(part, static_cast<std::size_t>(num_channels_), at, mix);
    position.sample += static_cast<std::uint64_t>(block_);
  }
}

}  // namespace earshot
