// SPDX-License-Identifier: Apache-2.0
#include "earshot/audio.h"

#include <fmt/format.h>

#include "sim/audio/dry_sounds/sound_clip.h"
#include "sim/audio/transforms/fir_convolver.h"
#include "sim/base/errors.h"

namespace earshot::api {

Audio load_sound(const std::string& spec, double sample_rate_hz) {
  SoundClip clip = open_sound(spec, static_cast<float>(sample_rate_hz));
  return {1, static_cast<double>(clip.sample_rate_hz), std::move(clip.samples)};
}

Audio load_audio(const std::filesystem::path& path) {
  SoundChannels sound = load_sound_channels(path);
  return {sound.num_channels, static_cast<double>(sound.sample_rate_hz), std::move(sound.samples)};
}

Audio convolve(const Audio& dry, const Rir& rir) {
  if (dry.num_channels != 1) throw InputError("dry", fmt::format("has {} channels", dry.num_channels), "give a sound of one channel");
  if (dry.sample_rate_hz != rir.sample_rate_hz)
    throw InputError("dry", fmt::format("has {} Hz, the response {} Hz", dry.sample_rate_hz, rir.sample_rate_hz),
                     "load the sound at the rate of the response");
  if (rir.num_channels < 1 || rir.num_samples < 1) throw InputError("rir", "is empty", "render a response first");
  FirConvolver convolver;
  return {rir.num_channels, rir.sample_rate_hz, convolver.convolve(dry.samples, rir.samples, rir.num_channels), rir.channel_mask};
}

void write_wav(const std::filesystem::path& path, const Audio& audio) {
  earshot::write_wav(path, audio.samples, audio.num_channels, static_cast<float>(audio.sample_rate_hz), audio.channel_mask);
}

void write_wav(const std::filesystem::path& path, const Rir& rir) {
  earshot::write_wav(path, rir.samples, rir.num_channels, static_cast<float>(rir.sample_rate_hz), rir.channel_mask);
}

}  // namespace earshot::api
