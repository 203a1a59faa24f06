// SPDX-License-Identifier: Apache-2.0
#include "envs/hearing/source_hearing.h"

#include <algorithm>
#include <array>
#include <bit>
#include <iterator>
#include <optional>
#include <utility>

#include "envs/hearing/finite_values.h"
#include "envs/hearing/same_bits.h"
#include "sim/acoustics/model/diffraction_budget.h"
#include "sim/acoustics/synthesis/carriers.h"
#include "sim/acoustics/synthesis/synthesis_tables.h"
#include "sim/base/files.h"

namespace earshot {
namespace {

/// To turn speeds of agents into changes of delay: about that of air.
constexpr double kSpeedOfSoundMPerS = 343;

}  // namespace

HearingEngines::HearingEngines(std::shared_ptr<const SynthesisTables> tables, const StreamConfig& stream,
                               const SpectrogramConfig& spectrogram, std::shared_ptr<DrySpectra> dry_spectra, double most_speed_m_per_s)
    : synthesizer(tables),
      convolver(stream, tables->layout.num_channels(), std::move(dry_spectra)),
      glider(tables, stream.max_block_samples, std::min(most_speed_m_per_s / kSpeedOfSoundMPerS, PathGlider::kMaxSlope)),
      crossfade_samples(stream.crossfade_samples),
      max_rir_samples(stream.max_rir_samples),
      analyzer(spectrogram),
      interaural(spectrogram),
      num_channels(static_cast<std::size_t>(tables->layout.num_channels())),
      block(num_channels * static_cast<std::size_t>(stream.max_block_samples)),
      part(block.size()),
      window(num_channels * static_cast<std::size_t>(spectrogram.num_samples)) {}

std::shared_ptr<DrySpectra> make_dry_spectra(const StreamConfig& stream, int num_channels) {
  return std::make_shared<DrySpectra>(StreamConvolver::plan(stream, num_channels).fft_size, std::size_t{16} << 20);
}

void SourceHearing::begin(const PlayedSound& played) {
  played_ = played;
  clip_key_ = hash64(std::as_bytes(std::span(played.sound->clip.samples)));
  silent_ = played.sound->oversampled.silent();
  gliding_.forget();
  has_response_ = response_is_new_ = has_rir_ = fades_ = false;
  // Direct sound, every image and the waves of panels: no step allocates.
  if (played.source) response_.arrivals.reserve(played.source->candidates.size() + 1 + DiffractionBudget::kMostPanels);
  carrier_key_ = carrier_key(scene().scene->hash(), played.moving ? played.moving->home() : played.source->candidates.source());
}

bool sounds_within(const PlayedSound& played, std::size_t reach, int block) {
  if (played.sound->oversampled.silent()) return false;
  // Dry samples that the next block depends on: those of the block, and before it those that the RIR reaches back to.  Paths that glide
  // reach as far, and a filter's length further: twice the RIR is more than both.
  return played.position.segment(2 * reach, 2 * reach + static_cast<std::size_t>(block)).sounding > 0;
}

bool SourceHearing::sounds(const HearingEngines& engines, int block) const {
  return !silent_ && sounds_within(played_, static_cast<std::size_t>(engines.max_rir_samples), block);
}

void SourceHearing::trace(const Pose& pose, float ear_height_m, ListenerMemory* memory) {
  const EarlyCandidates& candidates = played_.moving ? played_.moving->candidates() : played_.source->candidates;
  if (has_response_ && same_bits(candidates.source(), traced_source_) && same_bits(pose.position, traced_position_)) {
    ++cached_responses_;
    return;
  }
  ears_ = pose.position + glm::vec3(0, ear_height_m, 0);
  const SourceField* field = played_.moving ? nullptr : played_.source->sound_field.get();
  if (memory && !field) response_.memory.use_memory_of(*memory);
  compute_energy_response(scene().acoustics, candidates, field, ears_, response_);
  traced_source_ = candidates.source();
  effects_.add(response_.effects);
  traced_position_ = pose.position;
  has_response_ = response_is_new_ = true;
}

bool SourceHearing::synthesize(HearingEngines& engines, double heading_rad, const std::function<void(std::span<float> rir)>& hook) {
  fades_ = false;  // fading between equal RIRs gives the bits of no fade
  if (has_rir_ && !response_is_new_ && std::bit_cast<std::uint64_t>(heading_rad) == std::bit_cast<std::uint64_t>(rendered_heading_rad_))
    return true;
  fades_ = has_rir_;
  std::swap(spectra_, previous_);
  if (response_is_new_) late_.forget();
  const std::span<const std::uint8_t> glides = engines.glider.choose(response_, &gliding_);
  engines.synthesizer.render(response_, heading_rad, {carrier_key_, ears_, played_.moving ? std::optional(traced_source_) : std::nullopt},
                             rir_, &late_, glides);
  if (hook) hook(rir_.samples);
  if (!all_finite(rir_.samples)) return false;
  engines.convolver.transform(rir_.samples, rir_.num_samples, spectra_);
  engines.glider.advance(response_, glides, heading_rad, gliding_);
  rendered_heading_rad_ = heading_rad;
  response_is_new_ = false;
  has_rir_ = true;
  return true;
}

void SourceHearing::convolve(HearingEngines& engines, int block, std::span<float> sound) {
  const StreamPosition position = played_.restarts ? played_.position.begun_anew() : played_.position;
  const RirSpectra* fades_from = fades_ && !played_.restarts ? &previous_ : nullptr;
  engines.convolver.convolve(played_.sound->clip, clip_key_, position, spectra_, fades_from, block, sound);
  engines.glider.render(played_.sound->oversampled, position, block, engines.crossfade_samples, gliding_, sound);
  if (played_.gain != 1.f)
    for (float& sample : sound) sample *= played_.gain;
  played_.position.sample += static_cast<std::uint64_t>(block);
}

void SourceHearing::pass(int block) {
  played_.position.sample += static_cast<std::uint64_t>(block);
  if (!has_rir_ || silent_) return;
  gliding_.forget();
  response_is_new_ = has_response_;  // the RIR is made anew when it is heard again, and fades from none
  has_rir_ = fades_ = false;
}

}  // namespace earshot
