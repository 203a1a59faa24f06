#pragma once

#include <map>
#include <span>
#include <string>

#include "envs/episode.h"
#include "sim/audio/sound_clip.h"

namespace earshot {

/// The dry sounds of episodes, opened once, scaled and shared.  Immutable.
class SoundLibrary {
 public:
  /// Throws InputError that names the sound and an episode that names it.
  SoundLibrary(std::span<const Episode> episodes, const std::string& sound_root, float sample_rate_hz, float gain);
  /// name: Episode::sound of one of the episodes.
  [[nodiscard]] const SoundClip& clip(const std::string& name) const { return clips_.at(name); }

 private:
  std::map<std::string, SoundClip> clips_;
};

/// The argument of open_sound for a name in an episode: `synth:...` as it is; else a file under sound_root (.wav, .flac or .ogg added if it
/// has no such ending), else the path itself.
std::string resolve_sound(const std::string& name, const std::string& sound_root);

}  // namespace earshot
