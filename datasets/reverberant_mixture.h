// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cmath>
#include <cstddef>
#include <cstdint>
#include <span>
#include <string>
#include <vector>

#include "datasets/convolve_corpus.h"
#include "datasets/corpus_sounds.h"
#include "datasets/response_index.h"
#include "sim/audio/transforms/fir_convolver.h"
#include "sim/base/random.h"

namespace earshot {

/// One talker of a mixture; all sounds have the length of the mixture.
struct MixedTalker {
  std::string speech;  ///< path within its folder
  std::size_t response = 0, start_sample = 0, dry_samples = 0;
  double gain = 1;                             ///< on the dry sound as it was read and resampled, before the response
  std::vector<float> reverberant, early, dry;  ///< [channels, n], [channels, n] or empty, [n] or empty

  /// Frames from the first sample of the mixture to the last of its direct sound.
  [[nodiscard]] std::size_t direct_end(double direct_delay_s, double rate_hz) const {
    return start_sample + dry_samples + static_cast<std::size_t>(std::lround(direct_delay_s * rate_hz));
  }
};

struct MixedNoise {
  std::string sound;               ///< path within its folder, or synth...
  std::ptrdiff_t response = -1;    ///< -1: none, each channel has noise of its own
  std::uint64_t start_sample = 0;  ///< of the noise file, which loops: drawn, or for its loudest sample where it is silent from there on
  double snr_db = 0, gain = 1;
  std::vector<float> samples;  ///< [channels, n]
};

struct Mixture {
  std::size_t num_frames = 0;
  std::vector<MixedTalker> talkers;
  bool has_noise = false;
  MixedNoise noise;
  std::vector<float> samples;  ///< [channels, n]
  double level_dbfs = 0;
  bool lowered = false;
};

/// Mixes signal `number`, a function of (config, index, files, number).  Owns scratch: one per thread.
class MixtureMaker {
 public:
  /// All must outlive this.  noise: null if config.noise is not a folder.
  /// wished: null to draw all responses equally often.
  MixtureMaker(const ConvolveConfig& config, const ResponseIndex& index, const SoundFolder& speech, const SoundFolder* noise,
               const WishedResponses* wished)
      : config_(config), index_(index), speech_(speech), noise_(noise), wished_(wished) {}
  /// Throws InputError: a file that cannot be read, or that is silent, also through its response.
  Mixture mix(std::uint64_t number);

 private:
  [[nodiscard]] std::vector<std::size_t> draw_responses(std::uint64_t number, std::size_t count) const;
  /// Names the file of a talker, reads it and draws when it starts.
  std::vector<float> open_talker(Mixture& mixture, std::uint64_t number, std::size_t talker, std::size_t response) const;
  /// Sets the length of the mixture, to the end of whoever ends last, and renders all talkers.
  void render_talkers(Mixture& mixture, std::uint64_t number, const std::vector<std::vector<float>>& dry);
  /// At the level that was drawn relative to the first talker.
  void set_level(Mixture& mixture, std::uint64_t number, std::size_t talker) const;
  void add_noise(Mixture& mixture, std::uint64_t number);
  /// Of a source that is left in the room, at the place of the first talker where there is one; -1: none is left.
  [[nodiscard]] std::ptrdiff_t draw_noise_response(const Mixture& mixture, const RandomStream& random) const;
  /// Names the sound and returns its samples; empty: white noise without an end.
  std::vector<float> open_noise(MixedNoise& noise, const RandomStream& random) const;
  /// Writes noise.samples and noise.start_sample.
  void render_noise(Mixture& mixture, std::uint64_t number, const std::vector<float>& clip);
  std::vector<float> convolved(const IndexedResponse& response, const std::string& file, std::span<const float> dry);
  /// [num_frames]: the dry sound as an omnidirectional microphone in the open would hear it, to a fraction of a sample.
  std::vector<float> direct_sound(const IndexedResponse& response, std::span<const float> dry, std::size_t start_sample,
                                  std::size_t num_frames);

  const ConvolveConfig& config_;
  const ResponseIndex& index_;
  const SoundFolder& speech_;
  const SoundFolder* noise_;
  const WishedResponses* wished_;
  FirConvolver convolver_, direct_convolver_;
};

}  // namespace earshot
