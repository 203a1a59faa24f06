#pragma once

#include <cstdint>
#include <functional>
#include <span>
#include <vector>

#include "envs/scene_cache.h"
#include "envs/sound_library.h"
#include "sim/acoustics/response/energy_response.h"
#include "sim/acoustics/synthesis/path_glide.h"
#include "sim/acoustics/synthesis/rir_synthesis.h"
#include "sim/audio/sound_stream.h"
#include "sim/audio/spectrogram.h"
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
  int crossfade_samples;
  SpectrogramAnalyzer analyzer;
  std::vector<float> block;   ///< [2, block samples]
  std::vector<float> window;  ///< [2, window samples], for the legacy spectrogram
};

/// A cache of 16 MiB for the spectra of the dry sounds of all agents.
std::shared_ptr<DrySpectra> make_dry_spectra(const StreamConfig& stream);

/// The sound at the ears of one agent in one episode: the energy response of its source, the RIR made of it, and the position in the dry
/// sound.  One agent is used by one thread at a time.
/// The stages are called in the order of the data: trace, synthesize, convolve, analyze.  Of a sound that is silence throughout, nothing is
/// traced, rendered or convolved: it is zeros in every room.
class AgentHearing {
 public:
  /// The sound has been playing before: the first window holds the reverberation of a past spent at the start.
  /// source, sound: must outlive the episode.  clip_offset: clip sample at stream sample 0, where the first window begins.
  void begin(const EnvSource& source, const LibrarySound& sound, std::uint64_t clip_offset);

  /// Energy response at the ears.  Skipped where the position has the bits of the last call: the response is a function of it.
  void trace(const EnvSource& source, const Pose& pose, float ear_height_m);
  /// RIR of the response at this heading, without its strong paths, which glide; the one before becomes the RIR to fade from.  Skipped
  /// where neither changed.  hook: called with the RIR before it is used.  Returns false if the RIR is not finite: nothing can be heard
  /// then until begin().
  bool synthesize(HearingEngines& engines, double heading_rad, const std::function<void(std::span<float> rir)>& hook = {});
  /// The next `block` samples: written to `sound` [2, block] and pushed into the rolling `window` [2, samples].  Returns false if they
  /// were not finite: zeros are written then.
  bool convolve(HearingEngines& engines, int block, std::span<float> sound, std::span<float> window);
  /// Spectrogram [rows, columns, 2] of the window that convolve() filled: only frames with new samples are worked out.
  void analyze(HearingEngines& engines, std::span<const float> window, std::span<float> spectrogram);
  /// Fills the window as if the agent had stood here before, and leaves its last `block` samples in `sound`.
  bool fill_window(HearingEngines& engines, int block, std::span<float> sound, std::span<float> window);
  /// Jumps to stream sample `sample`: a replay that starts in the middle.
  void seek(std::uint64_t sample) { position_.sample = sample; }
  /// Of all poses traced since construction.
  [[nodiscard]] const EffectCounters& effects() const { return effects_; }
  /// Calls of trace() that reused the response of the last position, since construction.
  [[nodiscard]] std::uint64_t cached_responses() const { return cached_responses_; }

 private:
  const LibrarySound* dry_ = nullptr;
  std::uint64_t carrier_key_ = 0;
  std::uint64_t clip_key_ = 0;
  StreamPosition position_;
  EnergyResponse response_;
  EffectCounters effects_;
  std::uint64_t cached_responses_ = 0;
  LateSound late_;  ///< of response_
  Rir rir_;
  RirSpectra spectra_, previous_;  ///< of rir_ and of the one before
  GlidingPaths gliding_;
  SpectrogramHistory history_;
  std::size_t new_samples_ = 0;  ///< pushed since the last analysis
  glm::vec3 traced_position_{0}, ears_{0};
  double rendered_heading_rad_ = 0;
  bool silent_ = false;  ///< every sample of the clip is zero
  bool has_response_ = false, response_is_new_ = false, has_rir_ = false, fades_ = false;
};

/// Whether all values are finite.  Compiles to a few vector instructions per eight values.
bool all_finite(std::span<const float> values);

}  // namespace earshot
