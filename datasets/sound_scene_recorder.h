#pragma once

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

/// Renders the events of sound scenes at their listener.  Owns scratch: one per thread.
class SoundSceneRecorder {
 public:
  /// tables: of the channels that are wanted.
  SoundSceneRecorder(const SoundSceneConfig& config, std::shared_ptr<const SynthesisTables> tables);

  /// Seconds between two responses of a source that moves; strong paths glide between them, the rest fades (path_glide.h).
  static constexpr double kStepS = 0.05;
  /// Adds an event to `mix` [channels, frames] from its onset on; what rings on after the last frame is cut.  The dry sound is scaled to a
  /// root mean square of level_db over 1 while it sounds.  carrier: of the noise of its late field. Throws InputError: a sound that cannot
  /// be read or is silent.
  void add(const CorpusRoom& room, const SoundEvent& event, const CorpusListener& listener, const SoundSource& source,
           std::uint64_t carrier, std::size_t frames, std::span<float> mix);
  [[nodiscard]] int num_channels() const { return num_channels_; }

 private:
  void add_resting(const CorpusRoom& room, const SoundEvent& event, const CorpusListener& listener, const SoundSource& source,
                   std::uint64_t carrier, const SoundClip& clip, std::size_t sounding, std::size_t first, std::size_t frames,
                   std::span<float> mix);
  void add_moving(const CorpusRoom& room, const SoundEvent& event, const CorpusListener& listener, SoundSource source,
                  std::uint64_t carrier, const SoundClip& clip, std::size_t sounding, std::size_t first, std::size_t frames,
                  std::span<float> mix);

  const SoundSceneConfig& config_;
  int num_channels_, block_;
  RirSynthesizer synthesizer_;
  PathGlider glider_;
  FirConvolver fir_;
  std::optional<StreamConvolver> stream_;
  EnergyResponse response_;
};

}  // namespace earshot
