// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <functional>
#include <memory>
#include <span>
#include <vector>

#include "envs/hearing/moving_source.h"
#include "envs/hearing/sound_library.h"
#include "envs/scenes/scene_cache.h"
#include "sim/acoustics/response/energy_response.h"
#include "sim/acoustics/synthesis/path_glide.h"
#include "sim/acoustics/synthesis/rir_synthesis.h"
#include "sim/audio/stream/sound_stream.h"
#include "sim/audio/transforms/interaural_spectrogram.h"
#include "sim/audio/transforms/spectrogram.h"
#include "sim/vision/camera.h"

namespace earshot {

/// Engines of the sound stages: plans and scratch without state between calls.  One per thread.
struct HearingEngines {
  /// dry_spectra: see make_dry_spectra; shared by the engines of all threads, null: none are cached.  most_speed_m_per_s: an agent that
  /// moves faster has been put elsewhere, and what it heard fades over stream.crossfade_samples.
  HearingEngines(std::shared_ptr<const SynthesisTables> tables, const StreamConfig& stream, const SpectrogramConfig& spectrogram,
                 std::shared_ptr<DrySpectra> dry_spectra = nullptr, double most_speed_m_per_s = 5);
  RirSynthesizer synthesizer;
  StreamConvolver convolver;
  PathGlider glider;
  int crossfade_samples, max_rir_samples;
  SpectrogramAnalyzer analyzer;
  InterauralAnalyzer interaural;
  std::size_t num_channels;
  std::vector<float> block;   ///< [channels, block samples], of an odd piece
  std::vector<float> part;    ///< [channels, block samples], of one source among several
  std::vector<float> window;  ///< [channels, window samples], for the legacy spectrogram
};

/// A cache of 16 MiB for the spectra of the dry sounds of all agents.
std::shared_ptr<DrySpectra> make_dry_spectra(const StreamConfig& stream, int num_channels);

/// A source in one episode, and what it plays.  source, moving, sound: must outlive the episode.
struct PlayedSound {
  const EnvSource* source = nullptr;     ///< of a source at rest
  const MovingSource* moving = nullptr;  ///< or one that moves: moved to where it is at the end of each step before it is traced
  const LibrarySound* sound = nullptr;
  StreamPosition position = {};  ///< at the first sample of the first window
  float gain = 1;
  bool restarts = false;  ///< EnvConfig::sound_restarts
};
/// Whether samples of the next `block` may hold sound of it.  reach: the longest RIR in samples.
bool sounds_within(const PlayedSound& played, std::size_t reach, int block);

/// One source as one agent hears it: the energy response, the RIR made of it, and the position in the dry sound.  Used by one thread at a
/// time.  The stages are called in the order of the data: trace, synthesize, convolve.  Of a source that does not sound in the next block,
/// before its onset or when its last echo is over, nothing is traced, rendered or convolved: it is zeros in every room.
class SourceHearing {
 public:
  void begin(const PlayedSound& played);
  /// Whether samples of the next `block` may hold sound.
  [[nodiscard]] bool sounds(const HearingEngines& engines, int block) const;

  /// Energy response at the ears, from where the source is.  Skipped where neither has moved by a bit since the last call: the response is
  /// a function of the two places.  Of a source that moves late sound is traced, field or not.  memory: of the rays of this agent, which
  /// the sources that are traced without a field may share; null: its own.
  void trace(const Pose& pose, float ear_height_m, ListenerMemory* memory = nullptr);
  /// RIR of the response at this heading, without its strong paths, which glide; the one before becomes the RIR to fade from.  Skipped
  /// where neither changed.  hook: called with the RIR before it is used.  Returns false if the RIR is not finite: the source is silent
  /// then until begin().
  bool synthesize(HearingEngines& engines, double heading_rad, const std::function<void(std::span<float> rir)>& hook);
  /// The next `block` samples, written to `sound` [channels, block].
  void convolve(HearingEngines& engines, int block, std::span<float> sound);
  /// The next `block` samples are not heard: clears the history.
  void pass(int block);
  void seek(std::uint64_t sample) { played_.position.sample = sample; }

  [[nodiscard]] const EffectCounters& effects() const { return effects_; }
  [[nodiscard]] std::uint64_t cached_responses() const { return cached_responses_; }

 private:
  [[nodiscard]] const EnvScene& scene() const { return played_.moving ? *played_.moving->scene() : *played_.source->scene; }

  PlayedSound played_;
  std::uint64_t carrier_key_ = 0, clip_key_ = 0;
  EnergyResponse response_;
  EffectCounters effects_;
  std::uint64_t cached_responses_ = 0;
  LateSound late_;  ///< of response_
  Rir rir_;
  RirSpectra spectra_, previous_;  ///< of rir_ and of the one before
  GlidingPaths gliding_;
  glm::vec3 traced_position_{0}, traced_source_{0}, ears_{0};
  double rendered_heading_rad_ = 0;
  bool silent_ = false;  ///< every sample of the clip is zero
  bool has_response_ = false, response_is_new_ = false, has_rir_ = false, fades_ = false;
};

}  // namespace earshot
