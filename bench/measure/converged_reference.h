// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <functional>
#include <memory>
#include <optional>
#include <span>
#include <vector>

#include "bench/measure/bench_scene.h"
#include "bench/measure/response_errors.h"
#include "sim/acoustics/source_field/source_field.h"
#include "sim/audio/dry_sounds/sound_clip.h"
#include "sim/audio/stream/sound_stream.h"
#include "sim/audio/transforms/spectrogram.h"

namespace earshot {

/// Renders a response for two ears and measures all that is compared.  One per thread.
class ResponseListener {
 public:
  /// tables: of the response's rate, bands and length.
  explicit ResponseListener(std::shared_ptr<const SynthesisTables> tables, float sample_rate_hz, int rir_samples);
  HeardResponse hear(const AcousticScene& scene, const EnergyResponse& response, double heading_rad, std::uint64_t carrier_key);

 private:
  RirSynthesizer synthesizer_;
  SoundClip clip_;
  StreamConvolver convolver_;
  SpectrogramAnalyzer analyzer_;
  Rir rir_;
  std::vector<float> sound_, spectrogram_;
};

/// Tables for two ears behind the product's own head.
std::shared_ptr<const SynthesisTables> binaural_tables(const AcousticScene& scene);

/// The truth at some poses: the mean of independent responses of the preset `high`, and what it may still be wrong by.
struct ConvergedPose {
  WalkPose pose;
  EnergyResponse response;
  int runs = 0;
  std::vector<std::optional<double>> t20_error, t30_error;  ///< per band: standard error of the mean over its value
};

/// Fills in the standard errors from the batches of the response.
void add_errors(const AcousticScene& scene, ConvergedPose& pose);

/// high: configuration; its seed is not used, so that no tested mode has a random number in common with the truth.  Two runs
/// at every pose, then one more where it lowers the mean standard error of T20 most, until `seconds` are spent.  progress: fraction done.
std::vector<ConvergedPose> converge(const AcousticScene& high, const EarlyCandidates& candidates, const std::vector<WalkPose>& poses,
                                    double seconds, const std::function<void(double)>& progress);
/// Runs at all poses together.
int count_runs(const std::vector<ConvergedPose>& truth);
/// Mean over bands and poses of t20_error, as a fraction.
double mean_t20_error(const std::vector<ConvergedPose>& truth);

}  // namespace earshot
