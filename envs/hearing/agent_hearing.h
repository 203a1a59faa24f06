// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <functional>
#include <span>
#include <vector>

#include "envs/hearing/source_hearing.h"

namespace earshot {

/// Noise at the ears that comes from no source of the episode: white in the band of the sound, another for each ear or other channel.
struct BackgroundNoise {
  float rms = 0;  ///< 0: none
  std::uint64_t seed = 0;
  std::uint32_t stream = 0, episode = 0, agent = 0;
};

/// The sound at the ears of one agent in one episode: the sum of what its sources bring, and noise.  One agent is used by one thread at a
/// time.  The stages are called in the order of the data: trace, synthesize, convolve, analyze.
class AgentHearing {
 public:
  /// Sounds that have been playing before: the first window holds the reverberation of a past spent at the start.
  void begin(std::span<const PlayedSound> played, const BackgroundNoise& noise = {});

  /// Energy responses at the ears, of the sources that sound in the next `block` samples; those that move are where they are at their end.
  void trace(const HearingEngines& engines, const Pose& pose, float ear_height_m, int block);
  /// Their RIRs.  Returns false if one is not finite: see SourceHearing.
  bool synthesize(HearingEngines& engines, double heading_rad, const std::function<void(std::span<float> rir)>& hook = {});
  /// The next `block` samples: written to `sound` [channels, block] and pushed into the rolling `window` [channels, samples].  Returns
  /// false if they were not finite: zeros are written then.
  bool convolve(HearingEngines& engines, int block, std::span<float> sound, std::span<float> window);
  /// Spectrogram [rows, columns, channels] and interaural cells [rows, columns, 4] of the window that convolve() filled, where they are not
  /// empty: only frames with new samples are worked out.
  void analyze(HearingEngines& engines, std::span<const float> window, std::span<float> spectrogram, std::span<float> interaural);
  /// Fills the window as if the agent had stood here before, and leaves its last `block` samples in `sound`.
  bool fill_window(HearingEngines& engines, int block, std::span<float> sound, std::span<float> window);
  /// Jumps to stream sample `sample`: a replay that starts in the middle.
  void seek(std::uint64_t sample);
  /// Of all poses traced since construction.
  [[nodiscard]] EffectCounters effects() const;
  /// Calls of trace() that reused the response of the last position, since construction.
  [[nodiscard]] std::uint64_t cached_responses() const;

 private:
  void add_noise(std::span<float> sound, std::size_t num_channels) const;

  std::vector<SourceHearing> sources_;  ///< as many as any episode had: storage is kept
  std::vector<std::uint8_t> sounding_;  ///< [sources of this episode] in the block of the last trace()
  ListenerMemory memory_;               ///< rays that sources without a field share: of three and more, the bits of a trace each
  BackgroundNoise noise_;
  std::uint64_t sample_ = 0;  ///< of the stream, at which the next block begins
  SpectrogramHistory history_;
  InterauralHistory interaural_history_;
  std::size_t new_samples_ = 0;  ///< pushed since the last analysis
};

}  // namespace earshot
