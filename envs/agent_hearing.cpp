#include "envs/agent_hearing.h"

#include <algorithm>
#include <array>
#include <bit>
#include <utility>

#include "sim/acoustics/synthesis/carriers.h"
#include "sim/base/files.h"

namespace earshot {
namespace {

/// To turn speeds of agents into changes of delay: about that of air.
constexpr double kSpeedOfSoundMPerS = 343;

bool same_bits(glm::vec3 a, glm::vec3 b) {
  return std::bit_cast<std::array<std::uint32_t, 3>>(a) == std::bit_cast<std::array<std::uint32_t, 3>>(b);
}

/// Appends [2, n] to the end of a rolling [2, samples], dropping the oldest.
void push(std::span<const float> sound, std::span<float> window) {
  const std::size_t n = sound.size() / 2, samples = window.size() / 2;
  for (std::size_t ear = 0; ear < 2; ++ear) {
    const auto row = window.subspan(ear * samples, samples);
    std::copy(row.begin() + static_cast<std::ptrdiff_t>(n), row.end(), row.begin());
    std::copy_n(sound.begin() + static_cast<std::ptrdiff_t>(ear * n), n, row.end() - static_cast<std::ptrdiff_t>(n));
  }
}

}  // namespace

bool all_finite(std::span<const float> values) {
  constexpr std::uint32_t exponent = 0x7F800000u;  // all ones for infinities and NaN
  std::uint32_t bad = 0;
  for (const float value : values) bad |= (std::bit_cast<std::uint32_t>(value) & exponent) == exponent ? 1u : 0u;
  return bad == 0;
}

HearingEngines::HearingEngines(std::shared_ptr<const SynthesisTables> tables, const StreamConfig& stream,
                               const SpectrogramConfig& spectrogram, std::shared_ptr<DrySpectra> dry_spectra, double most_speed_m_per_s)
    : synthesizer(tables),
      convolver(stream, 2, std::move(dry_spectra)),
      glider(std::move(tables), stream.max_block_samples, std::min(most_speed_m_per_s / kSpeedOfSoundMPerS, PathGlider::kMostSlope)),
      crossfade_samples(stream.crossfade_samples),
      analyzer(spectrogram),
      block(2 * static_cast<std::size_t>(stream.max_block_samples)),
      window(2 * static_cast<std::size_t>(spectrogram.num_samples)) {}

std::shared_ptr<DrySpectra> make_dry_spectra(const StreamConfig& stream) {
  return std::make_shared<DrySpectra>(StreamConvolver::plan(stream, 2).fft_size, std::size_t{16} << 20);
}

void AgentHearing::begin(const EnvSource& source, const LibrarySound& sound, std::uint64_t clip_offset) {
  dry_ = &sound;
  clip_key_ = hash64(std::as_bytes(std::span(sound.clip.samples)));
  silent_ = sound.oversampled.silent();
  gliding_.forget();
  history_.forget();
  new_samples_ = 0;
  position_ = {.sample = 0, .clip_offset = clip_offset, .already_playing = true};
  has_response_ = response_is_new_ = has_rir_ = fades_ = false;
  response_.arrivals.reserve(source.candidates.size() + 1);  // direct sound and every image: no step allocates
  carrier_key_ = carrier_key(source.scene->scene->hash(), source.candidates.source());
}

void AgentHearing::trace(const EnvSource& source, const Pose& pose, float ear_height_m) {
  if (silent_) return;
  if (has_response_ && same_bits(pose.position, traced_position_)) {
    ++cached_responses_;
    return;
  }
  ears_ = pose.position + glm::vec3(0, ear_height_m, 0);
  compute_energy_response(source.scene->acoustics, source.candidates, source.sound_field.get(), ears_, response_);
  effects_.add(response_.effects);
  traced_position_ = pose.position;
  has_response_ = response_is_new_ = true;
}

bool AgentHearing::synthesize(HearingEngines& engines, double heading_rad, const std::function<void(std::span<float> rir)>& hook) {
  fades_ = false;  // fading between equal RIRs gives the bits of no fade
  if (silent_) return true;
  if (has_rir_ && !response_is_new_ && std::bit_cast<std::uint64_t>(heading_rad) == std::bit_cast<std::uint64_t>(rendered_heading_rad_))
    return true;
  fades_ = has_rir_;
  std::swap(spectra_, previous_);
  if (response_is_new_) late_.forget();
  const std::span<const std::uint8_t> glides = engines.glider.choose(response_, &gliding_);
  engines.synthesizer.render(response_, heading_rad, {carrier_key_, ears_}, rir_, &late_, glides);
  if (hook) hook(rir_.samples);
  if (!all_finite(rir_.samples)) return false;
  engines.convolver.transform(rir_.samples, rir_.num_samples, spectra_);
  engines.glider.advance(response_, glides, heading_rad, gliding_);
  rendered_heading_rad_ = heading_rad;
  response_is_new_ = false;
  has_rir_ = true;
  return true;
}

bool AgentHearing::convolve(HearingEngines& engines, int block, std::span<float> sound, std::span<float> window) {
  if (silent_) {
    std::fill(sound.begin(), sound.end(), 0.f);
  } else {
    engines.convolver.convolve(dry_->clip, clip_key_, position_, spectra_, fades_ ? &previous_ : nullptr, block, sound);
    engines.glider.render(dry_->oversampled, position_, block, engines.crossfade_samples, gliding_, sound);
  }
  position_.sample += static_cast<std::uint64_t>(block);
  const bool finite = all_finite(sound);
  if (!finite) std::fill(sound.begin(), sound.end(), 0.f);
  push(sound, window);
  new_samples_ += static_cast<std::size_t>(block);
  return finite;
}

void AgentHearing::analyze(HearingEngines& engines, std::span<const float> window, std::span<float> spectrogram) {
  engines.analyzer.analyze(window, new_samples_, history_, spectrogram);
  new_samples_ = 0;
}

bool AgentHearing::fill_window(HearingEngines& engines, int block, std::span<float> sound, std::span<float> window) {
  const auto samples = static_cast<int>(window.size() / 2);
  bool finite = true;
  // The odd piece first, so that the last call leaves whole block in `sound`.
  if (const int odd = samples % block; odd > 0)
    finite = convolve(engines, odd, std::span(engines.block).first(2 * static_cast<std::size_t>(odd)), window);
  for (int piece = 0; piece < samples / block; ++piece) finite = convolve(engines, block, sound, window) && finite;
  return finite;
}

}  // namespace earshot
