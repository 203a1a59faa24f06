// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <complex>
#include <cstdint>
#include <memory>
#include <span>
#include <vector>

#include "sim/acoustics/response/energy_response.h"
#include "sim/acoustics/synthesis/arrival_filters.h"
#include "sim/audio/head/listener_orientation.h"
#include "sim/audio/stream/oversampled_sound.h"
#include "sim/audio/transforms/fft.h"

namespace earshot {

/// The strong paths of one listener and source at the last two poses.  A plain value; starts empty.
class GlidingPaths {
 public:
  void forget() {
    now_.count = before_.count = 0;
    known_ = moves_ = false;
  }

 private:
  friend class PathGlider;
  /// At one pose.  Rows of paths that are not counted are room for later ones.
  struct Pose {
    std::size_t count = 0;
    std::vector<std::uint64_t> identity;      ///< [path]
    std::vector<std::uint8_t> by_right;       ///< [path] 1: among the strongest without what the pose before adds
    std::vector<int> partner;                 ///< [path]: of the pose before; -1: none
    std::vector<double> delay, slope;         ///< [path][channel]: samples, and their growth per sample of the previous block
    std::vector<std::complex<float>> filter;  ///< [path][channel][bin]
  };
  Pose now_, before_;
  int samples_ = 0;     ///< from the one to the other
  bool known_ = false;  ///< is there a pose?
  bool moves_ = false;  ///< from the one to the other, in the next block
};

/// Sound of a listener's strong paths while source and listener move: each path that exists at both poses glides over the block from one
/// delay to the other (a line through which the dry sound is read at a changing place, which is its Doppler shift too) and fades from one
/// filter to the other, both without delay; so nothing combs.  A head that turns glides likewise, ear by ear.  Paths of one pose alone fade
/// in or out in place.  All other arrivals and the late field are the matter of StreamConvolver, whose responses must leave these paths
/// out.
/// Delay lines with interpolation: Smith, Serafin, Abel and Berners 2002 (Doppler); matched paths: Tsingos 2001.
/// Owns scratch: one per thread.
class PathGlider {
 public:
  /// block_samples: of a block between two poses.  The strongest paths within kRangeDb of the strongest glide, as many as the config says;
  /// one whose delay would change by more than most_slope, in (0, 0.25] samples per sample, has jumped, and fades.
  PathGlider(std::shared_ptr<const SynthesisTables> tables, int block_samples, double most_slope = kMaxSlope);

  static constexpr double kRangeDb = 12, kKeptDb = 2;
  /// 86 m/s, of a source that approaches 69 m/s.
  static constexpr double kMaxSlope = 0.25;

  /// Marks the arrivals that are heard through this: [arrivals] of 0 or 1, for RirSynthesizer::render.  before: of the pose before; null:
  /// none.  What was among the strongest there counts as stronger by kKeptDb, so that paths of about one level do not take turns; what
  /// was kept there by that alone does not, so that the choice depends on two poses and no others.  Valid until the next call.
  std::span<const std::uint8_t> choose(const EnergyResponse& response, const GlidingPaths* before = nullptr);
  /// A new pose: its strong paths are those that the next block leads to.  marked: of the last choose, for this response.  samples: of
  /// that block where it is shorter than block_samples; 0: it is not.
  void advance(const EnergyResponse& response, std::span<const std::uint8_t> marked, const ListenerOrientation& orientation,
               GlidingPaths& paths, int samples = 0);
  /// Adds what the paths bring in stream samples [position.sample, position.sample + block) to output [num_channels, block].  The first
  /// call after advance() leads from the pose before to the new one, over the samples given there; further ones stay there.  fade: samples
  /// over which paths of one pose alone fade.  About 20 us per path for two ears and 150 ms at 16 kHz; no allocation once warm.
  void render(const OversampledSound& sound, const StreamPosition& position, int block, int fade, GlidingPaths& paths,
              std::span<float> output);

 private:
  using Pose = GlidingPaths::Pose;
  /// One path in one block, per channel: from delay at the start on by slope; slope_before up to the start.
  struct Line {
    double delay, slope, slope_before;
  };
  /// Dry sound and the samples of the stream that a block takes.
  struct DryBlock {
    const OversampledSound& sound;
    const StreamPosition& position;
    int samples;
  };
  struct Sum {
    bool any = false;
    std::vector<std::complex<float>> spectrum;  ///< [channel][piece][bin]
  };
  void reserve(Pose& pose) const;
  void mark_strongest(std::span<const float> energy, float weakest, std::vector<std::uint8_t>& marked);
  void read_line(const DryBlock& dry, const Line& line);
  void add_present_paths(const DryBlock& dry, GlidingPaths& paths, bool moves);
  void add_leaving_paths(const DryBlock& dry, const GlidingPaths& paths);
  void fade_sums(int block, int fade, int glided_samples, std::span<float> output);
  void add_line(const DryBlock& dry, const Line& line, const std::complex<float>* filter, std::size_t channel, Sum& sum);
  [[nodiscard]] const std::complex<float>* filter_of(const Pose& pose, std::size_t row) const {
    return pose.filter.data() + row * num_bins_;
  }
  void add_product(const std::complex<float>* filter, std::size_t channel, Sum& sum);
  const float* inverse(const Sum& sum, std::size_t channel);
  /// Of a piece of line_ that is transformed, sum_time_ up to the end of the block.
  [[nodiscard]] std::size_t hop() const { return static_cast<std::size_t>(fft_.size()) - num_taps_ + 1; }

  ArrivalFilters filters_;
  int block_samples_, max_paths_;
  double most_slope_;
  std::size_t num_channels_, num_taps_;
  RealFft fft_;                                  ///< of pieces of a block: filters are transformed at each pose, and are short
  std::size_t num_bins_, num_pieces_;            ///< of a whole block
  std::size_t pieces_ = 0;                       ///< of the present one
  std::vector<std::uint8_t> marked_, by_right_;  ///< of the last choose
  std::vector<float> energy_, taps_, line_, piece_time_, sum_time_;
  std::vector<std::complex<float>> spectrum_;     ///< [piece][bin], of line_
  Sum resting_, from_, to_, entering_, leaving_;  ///< from_, to_: gliding paths, through the filters of the previous and the new pose
};

}  // namespace earshot
