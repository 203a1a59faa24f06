// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstddef>
#include <cstdint>
#include <memory>
#include <optional>
#include <span>
#include <vector>

#include "datasets/sound_scene_events.h"
#include "sim/acoustics/response/temporal_reuse.h"
#include "sim/acoustics/synthesis/path_glide.h"
#include "sim/acoustics/synthesis/rir_synthesis.h"
#include "sim/audio/stream/sound_stream.h"
#include "sim/audio/transforms/fir_convolver.h"

namespace earshot {

/// An event of a recording with its source and its listener.
struct PlacedEvent {
  const CorpusRoom& room;
  const SoundEvent& event;
  const CorpusListener& listener;
  SoundSource source;  ///< its directivity and orientation; the path of the event places it
};

/// The samples of a recording, to which events are added.
struct RecordingMix {
  std::size_t frames = 0;
  std::span<float> samples;  ///< [channels, frames]
};

/// Renders the events of sound scenes at their listener.  Owns scratch: one per thread.
class SoundSceneRecorder {
 public:
  /// tables: of the channels that are wanted.
  SoundSceneRecorder(const SoundSceneConfig& config, std::shared_ptr<const SynthesisTables> tables);

  /// Seconds between two responses of a source that moves; strong paths glide between them, the rest fades (path_glide.h).
  static constexpr double kStepS = 0.05;
  /// Adds an event to `mix` from its onset on; sound after the last frame is cut.  The dry sound is scaled to a root mean square of
  /// level_db over 1 while it sounds.  Returns the sample of the sound file, at the rate of the recording, with which it begins: 0, or 5 ms
  /// before the loudest where the file begins with a silence as long as the event.  Throws InputError: a sound that cannot be read or is
  /// silent.
  std::uint64_t add(const PlacedEvent& placed, const RecordingMix& mix);
  [[nodiscard]] int num_channels() const { return num_channels_; }

 private:
  /// The sound of an event without a room.
  struct DrySound {
    const SoundClip& clip;     ///< loops
    std::size_t first = 0;     ///< frame of the onset
    std::size_t sounding = 0;  ///< frames from there to the offset
  };
  void add_resting(const PlacedEvent& placed, const DrySound& dry, const RecordingMix& mix);
  void add_moving(const PlacedEvent& placed, const DrySound& dry, const RecordingMix& mix);

  const SoundSceneConfig& config_;
  int num_channels_, block_;
  RirSynthesizer synthesizer_;
  PathGlider glider_;
  FirConvolver fir_;
  std::optional<StreamConvolver> stream_;
  EnergyResponse response_;
};

}  // namespace earshot
