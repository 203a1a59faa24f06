// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <map>
#include <span>
#include <string>

#include "envs/task/episode.h"
#include "sim/audio/dry_sounds/sound_clip.h"
#include "sim/audio/stream/oversampled_sound.h"

namespace earshot {

/// A dry sound, and the same ready to be read between its samples.
struct LibrarySound {
  explicit LibrarySound(SoundClip opened) : clip(std::move(opened)), oversampled(clip) {}
  SoundClip clip;
  OversampledSound oversampled;
};

/// The dry sounds of episodes, opened once, scaled and shared.  Immutable.
class SoundLibrary {
 public:
  /// Throws InputError that names the sound and an episode that names it.
  SoundLibrary(std::span<const Episode> episodes, const std::string& sound_root, float sample_rate_hz, float gain);
  /// name: of a sound that one of the episodes plays.
  [[nodiscard]] const LibrarySound& sound(const std::string& name) const { return sounds_.at(name); }

 private:
  std::map<std::string, LibrarySound> sounds_;
};

/// The names of all sounds that the episodes play, each with the first episode that names it.
std::map<std::string, const Episode*> sounds_of(std::span<const Episode> episodes);

/// The argument of open_sound for a name in an episode: `synth:...` as it is; else a file under sound_root (.wav, .flac or .ogg added if it
/// has no such ending), else the path itself.
std::string resolve_sound(const std::string& name, const std::string& sound_root);

}  // namespace earshot
