// SPDX-License-Identifier: Apache-2.0
#include "datasets/reverberant_mixture.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <numbers>
#include <set>
#include <utility>

#include "sim/acoustics/core/arrival.h"
#include "sim/acoustics/synthesis/delayed_impulse.h"
#include "sim/base/errors.h"
#include "sim/base/files.h"
#include "sim/base/random.h"

namespace earshot {
namespace {

/// In the place of the scene in the streams of episodes: the signals of a corpus.
constexpr std::uint32_t kSignalStream = 0x434F4E56u;

/// Draw numbers of one talker; talker 0 also draws for the whole.  Fixed, so that a new consumer does not shift the others.
struct MixtureDraw {
  enum : std::uint32_t {
    talkers = 0,
    response = 1,
    level = 2,
    snr = 3,
    noise_file = 4,
    noise_start = 5,
    speech = 6,
    start = 7,
    gain = 8,
    source = 9,
    noise_source = 10,
    channel_start = 32
  };
};

RandomStream stream_of(const ConvolveConfig& config, std::uint64_t number, std::size_t talker) {
  return {config.seed, Purpose::episode, kSignalStream, static_cast<std::uint32_t>(number), static_cast<std::uint32_t>(talker)};
}

/// [channels, frames] to [channels, length], the sound from `start` on; the rest is cut.
std::vector<float> placed(std::span<const float> sound, std::size_t channels, std::size_t start, std::size_t length) {
  const std::size_t frames = sound.size() / channels;
  std::vector<float> result(channels * length, 0.f);
  if (start >= length) return result;
  const std::size_t count = std::min(frames, length - start);
  for (std::size_t c = 0; c < channels; ++c)
    std::copy_n(sound.begin() + static_cast<std::ptrdiff_t>(c * frames), count,
                result.begin() + static_cast<std::ptrdiff_t>(c * length + start));
  return result;
}

/// Unrelated for every (signal, channel).
RandomStream noise_stream(const ConvolveConfig& config, std::uint64_t number, std::size_t channel) {
  return {config.seed, Purpose::sound, kSignalStream, static_cast<std::uint32_t>(number), static_cast<std::uint32_t>(channel)};
}

/// Responses in the room of response `first` whose sources are free: those at its place, or all if there is none.
std::vector<std::size_t> free_responses(const ResponseIndex& index, std::size_t first, const std::set<int>& taken) {
  const std::vector<IndexedResponse>& all = index.responses();
  std::vector<std::size_t> free, here;
  for (const std::size_t i : index.room_of(first)) {
    if (taken.contains(all[i].source)) continue;
    free.push_back(i);
    if (all[i].place == all[first].place) here.push_back(i);
  }
  return here.empty() ? std::move(free) : std::move(here);
}

}  // namespace

std::vector<std::size_t> MixtureMaker::draw_responses(std::uint64_t number, std::size_t count) const {
  const RandomStream first = stream_of(config_, number, 0);
  const std::vector<IndexedResponse>& all = index_.responses();
  std::vector<std::size_t> drawn{wished_ ? wished_->draw(first.uniform(MixtureDraw::response))
                                         : first.below(static_cast<std::uint32_t>(all.size()), MixtureDraw::response)};
  std::set<int> taken{all[drawn[0]].source};
  while (drawn.size() < count) {
    const std::vector<std::size_t> among = free_responses(index_, drawn[0], taken);
    if (among.empty()) return drawn;
    const RandomStream random = stream_of(config_, number, drawn.size());
    drawn.push_back(among[random.below(static_cast<std::uint32_t>(among.size()), MixtureDraw::source)]);
    taken.insert(all[drawn.back()].source);
  }
  return drawn;
}

std::vector<float> MixtureMaker::convolved(const IndexedResponse& response, const std::string& file, std::span<const float> dry) {
  const SoundChannels filter = index_.load(response, file);
  return convolver_.convolve(dry, filter.samples, filter.num_channels);
}

std::vector<float> MixtureMaker::direct_sound(const IndexedResponse& response, std::span<const float> dry, std::size_t start_sample,
                                              std::size_t num_frames) {
  // As a response counts a source that is nearer than the engine tells apart.
  const double distance_m = std::max(response.distance_m, static_cast<double>(kMinDistanceM));
  const double farther = response.distance_m > 0 ? distance_m / response.distance_m : 1;
  const double delay_samples = farther * response.direct_delay_s * static_cast<double>(index_.sample_rate_hz());
  if (delay_samples > static_cast<double>(num_frames) + arrival_fft_size(index_.sample_rate_hz())) return std::vector<float>(num_frames);
  const std::vector<float> impulse = delayed_impulse(delay_samples, index_.sample_rate_hz());
  std::vector<float> sound = placed(direct_convolver_.convolve(dry, impulse, 1), 1, start_sample, num_frames);
  scale(sound, 1 / (4 * std::numbers::pi * distance_m));
  return sound;
}

std::vector<float> MixtureMaker::open_talker(Mixture& mixture, std::uint64_t number, std::size_t talker, std::size_t response) const {
  const RandomStream random = stream_of(config_, number, talker);
  const auto num_files = static_cast<std::uint32_t>(speech_.files.size());
  std::size_t file = static_cast<std::size_t>(number % num_files);
  if (talker > 0) {  // in steps from the first one, so that it is another file where there are two
    const std::uint32_t step = num_files > 1 ? 1 + random.below(num_files - 1, MixtureDraw::speech) : 0;
    file = (file + step) % num_files;
  }
  MixedTalker added;
  added.speech = speech_.files[file];
  added.response = response;
  std::vector<float> dry = load_sound(speech_.root / added.speech, index_.sample_rate_hz()).samples;
  if (peak_of(dry) <= 0) throw InputError((speech_.root / added.speech).string(), "is silent", "remove it from the folder");
  added.dry_samples = dry.size();
  // Within the first one, or with it if this one is longer.
  if (talker > 0 && dry.size() < mixture.talkers[0].dry_samples) {
    const std::size_t latest = mixture.talkers[0].dry_samples - dry.size();
    added.start_sample = random.below(static_cast<std::uint32_t>(latest + 1), MixtureDraw::start);
  }
  mixture.talkers.push_back(std::move(added));
  return dry;
}

void MixtureMaker::render_talkers(Mixture& mixture, std::uint64_t number, const std::vector<std::vector<float>>& dry) {
  const std::size_t channels = index_.channels().size();
  const auto rate_hz = static_cast<double>(index_.sample_rate_hz());
  std::vector<std::vector<float>> sounds;
  for (std::size_t t = 0; t < mixture.talkers.size(); ++t) {
    const MixedTalker& talker = mixture.talkers[t];
    const IndexedResponse& response = index_.responses()[talker.response];
    sounds.push_back(convolved(response, response.file, dry[t]));
    mixture.num_frames = std::max(mixture.num_frames, talker.direct_end(response.direct_delay_s, rate_hz));
    if (!config_.cut) mixture.num_frames = std::max(mixture.num_frames, talker.start_sample + sounds[t].size() / channels);
  }
  for (std::size_t t = 0; t < mixture.talkers.size(); ++t) {
    MixedTalker& talker = mixture.talkers[t];
    const IndexedResponse& response = index_.responses()[talker.response];
    const auto place = [&](std::span<const float> sound) { return placed(sound, channels, talker.start_sample, mixture.num_frames); };
    talker.reverberant = place(sounds[t]);
    if (config_.early) talker.early = place(convolved(response, response.early_file, dry[t]));
    if (config_.dry) talker.dry = direct_sound(response, dry[t], talker.start_sample, mixture.num_frames);
    set_level(mixture, number, t);
  }
}

void MixtureMaker::set_level(Mixture& mixture, std::uint64_t number, std::size_t talker) const {
  MixedTalker& added = mixture.talkers[talker];
  const double energy = energy_of(added.reverberant);
  if (energy <= 0)
    throw InputError((speech_.root / added.speech).string(),
                     fmt::format("is silent through response {}", index_.responses()[added.response].id),
                     "write the corpus of responses with a larger acoustics.rir_length_s");
  if (talker == 0) return;
  const double wanted = amplitude_of_db(within_range(config_.talker_db, stream_of(config_, number, talker).uniform(MixtureDraw::gain)));
  added.gain = std::sqrt(energy_of(mixture.talkers[0].reverberant) / energy) * wanted;
  for (std::vector<float>* samples : {&added.reverberant, &added.early, &added.dry}) scale(*samples, added.gain);
}

void MixtureMaker::add_noise(Mixture& mixture, std::uint64_t number) {
  const RandomStream random = stream_of(config_, number, 0);
  MixedNoise& noise = mixture.noise;
  mixture.has_noise = true;
  noise.response = draw_noise_response(mixture, random);
  const std::vector<float> clip = open_noise(noise, random);
  render_noise(mixture, number, clip);
  const double energy = energy_of(noise.samples);
  if (energy <= 0) throw InputError(noise_ ? (noise_->root / noise.sound).string() : noise.sound, "is silent", "remove it from the folder");
  noise.snr_db = within_range(config_.snr_db, random.uniform(MixtureDraw::snr));
  noise.gain = std::sqrt(energy_of(mixture.samples) / energy) / amplitude_of_db(noise.snr_db);
  scale(noise.samples, noise.gain);
  for (std::size_t i = 0; i < mixture.samples.size(); ++i) mixture.samples[i] += noise.samples[i];
}

std::ptrdiff_t MixtureMaker::draw_noise_response(const Mixture& mixture, const RandomStream& random) const {
  std::set<int> taken;
  for (const MixedTalker& talker : mixture.talkers) taken.insert(index_.responses()[talker.response].source);
  const std::vector<std::size_t> among = free_responses(index_, mixture.talkers[0].response, taken);
  if (among.empty()) return -1;
  return static_cast<std::ptrdiff_t>(among[random.below(static_cast<std::uint32_t>(among.size()), MixtureDraw::noise_source)]);
}

std::vector<float> MixtureMaker::open_noise(MixedNoise& noise, const RandomStream& random) const {
  std::vector<float> clip;
  if (noise_) {
    noise.sound = noise_->files[random.below(static_cast<std::uint32_t>(noise_->files.size()), MixtureDraw::noise_file)];
    clip = load_sound(noise_->root / noise.sound, index_.sample_rate_hz()).samples;
  } else if (config_.noise == "synth") {
    noise.sound = "synth";
  } else {
    noise.sound = fmt::format("{}:{}", config_.noise, random.below(1u << 30, MixtureDraw::noise_file));
    clip = synthesize_sound(noise.sound, index_.sample_rate_hz()).samples;
  }
  return clip;
}

void MixtureMaker::render_noise(Mixture& mixture, std::uint64_t number, const std::vector<float>& clip) {
  const RandomStream random = stream_of(config_, number, 0);
  const std::size_t channels = index_.channels().size(), frames = mixture.num_frames;
  MixedNoise& noise = mixture.noise;
  // heard: the sample of the part that is heard at the first sample of the mixture.  Each channel that draws a pause has a lag of its own,
  // so that no two are alike.
  const auto part = [&](std::size_t channel, std::size_t count, std::size_t heard) {
    if (clip.empty()) return white_noise(noise_stream(config_, number, channel), count);
    const auto size = static_cast<std::uint32_t>(clip.size());
    const std::uint64_t drawn =
        random.below(size, channel == 0 ? MixtureDraw::noise_start : MixtureDraw::channel_start + static_cast<std::uint32_t>(channel));
    const std::uint64_t start = sounding_start(clip, drawn, heard, frames, channel * frames / channels);
    if (channel == 0) noise.start_sample = start;
    return looped(clip, start, count);
  };
  if (noise.response >= 0) {
    // It sounds from before the first sample to after the last: reverberation of earlier sound is included, its end is not.
    const IndexedResponse& response = index_.responses()[static_cast<std::size_t>(noise.response)];
    const SoundChannels filter = index_.load(response, response.file);
    const std::size_t before = filter.num_frames() - 1;
    const auto delay = static_cast<std::size_t>(std::lround(response.direct_delay_s * static_cast<double>(index_.sample_rate_hz())));
    const std::size_t heard = before - std::min(before, delay);
    const std::vector<float> sound = convolver_.convolve(part(0, before + frames, heard), filter.samples, filter.num_channels);
    const std::size_t width = sound.size() / channels;
    noise.samples.resize(channels * frames);
    for (std::size_t c = 0; c < channels; ++c)
      std::copy_n(sound.begin() + static_cast<std::ptrdiff_t>(c * width + before), frames,
                  noise.samples.begin() + static_cast<std::ptrdiff_t>(c * frames));
  } else {
    for (std::size_t c = 0; c < channels; ++c) {
      const std::vector<float> channel = part(c, frames, 0);
      noise.samples.insert(noise.samples.end(), channel.begin(), channel.end());
    }
  }
}

Mixture MixtureMaker::mix(std::uint64_t number) {
  const RandomStream random = stream_of(config_, number, 0);
  const auto talkers = static_cast<std::size_t>(config_.min_talkers) +
                       random.below(static_cast<std::uint32_t>(config_.max_talkers - config_.min_talkers + 1), MixtureDraw::talkers);
  Mixture mixture;
  const std::vector<std::size_t> responses = draw_responses(number, talkers);
  std::vector<std::vector<float>> dry;
  for (std::size_t talker = 0; talker < responses.size(); ++talker) dry.push_back(open_talker(mixture, number, talker, responses[talker]));
  render_talkers(mixture, number, dry);
  mixture.samples.assign(mixture.talkers[0].reverberant.size(), 0.f);
  for (const MixedTalker& talker : mixture.talkers)
    for (std::size_t i = 0; i < mixture.samples.size(); ++i) mixture.samples[i] += talker.reverberant[i];
  if (!config_.noise.empty()) add_noise(mixture, number);

  const double mean_square = energy_of(mixture.samples) / static_cast<double>(mixture.samples.size());
  mixture.level_dbfs = within_range(config_.level_dbfs, random.uniform(MixtureDraw::level));
  double factor = amplitude_of_db(mixture.level_dbfs) / std::sqrt(mean_square);
  std::vector<std::vector<float>*> all{&mixture.samples, &mixture.noise.samples};
  for (MixedTalker& talker : mixture.talkers) all.insert(all.end(), {&talker.reverberant, &talker.early, &talker.dry});
  double peak = 0;
  for (const std::vector<float>* samples : all) peak = std::max(peak, peak_of(*samples));
  if (peak * factor > kMaxPeak) {
    mixture.lowered = true;
    mixture.level_dbfs += 20 * std::log10(kMaxPeak / (peak * factor));
    factor = kMaxPeak / peak;
  }
  for (std::vector<float>* samples : all) scale(*samples, factor);
  for (MixedTalker& talker : mixture.talkers) talker.gain *= factor;
  mixture.noise.gain *= factor;
  return mixture;
}

}  // namespace earshot
