// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstddef>
#include <cstdint>
#include <glm/vec3.hpp>
#include <optional>
#include <span>
#include <vector>

#include "sim/acoustics/core/bands.h"

namespace earshot {

/// Noise of one source at one place, for RirSynthesizer::render.  Equal keys give equal noise, different sources independent noise; how
/// noise changes with the place: late_carriers.h.
struct CarrierKey {
  /// A source alone has the same noise everywhere.
  // NOLINTNEXTLINE(google-explicit-constructor)
  CarrierKey(std::uint64_t source_key, std::optional<glm::vec3> listener_position = {}, std::optional<glm::vec3> source_position = {})
      : source(source_key), listener(listener_position), moving_source(source_position) {}
  std::uint64_t source;
  std::optional<glm::vec3> listener;       ///< in metres
  std::optional<glm::vec3> moving_source;  ///< of a source that moves under one key: where it is, in metres
};

/// Key of a source by position, for a source that moves by where it begins: its noise is the same in every response, walk, recording and
/// episode, and for every agent.  Sources elsewhere have independent noise, so that what several bring adds up.
std::uint64_t carrier_key(std::uint64_t scene_hash, glm::vec3 source_position);
/// Of a scene in which one source is heard.
inline std::uint64_t carrier_key(std::uint64_t scene_hash) { return scene_hash; }

/// plain: noise that is not flattened, for sums of so many channels that flattening would be lost; quick to make.
enum class CarrierKind { flattened, plain };

/// Noise on which late energy rides: one loop per band and channel, seeded.  The bands of a channel are cut from one white noise of unit
/// variance by BandFilters, so they add up to it again: bands of equal energy give the same white tail for every number of bands
/// (docs/evidence/oracles.md, O-31: one carrier, amplitude-complementary filters).  Channels are independent. The price: where neighbouring
/// bands differ, the crossover between them follows their amplitudes, not their energies.  At 3 dB per octave that takes 0.03 dB off the
/// sum, at 10 dB 0.3 dB, and 0.6 dB off an octave that stands alone.
///
/// The noise is flattened (docs/explanation/estimators.md, section 6): in every octave its power averaged over about 2 / bandwidth is
/// nearly constant, so that the decay of a rendered response is that of its energy.  Flattening each channel alone would be lost where
/// channels are mixed, as they are in the ears; the first four channels are therefore flattened together, so that every mixture of them is
/// flat.  Further ones, which only ambisonics above first order have, are flattened alone.
///
/// Flattening takes long, so what is flat is used in four ways: loops are of four kinds, the first four channels (N3D: w, y, z, x) as they
/// are or as (y', -w', x', -z') of the same loops, forwards and backwards.  All are equally flat, and two of them correlate no more than
/// independent noises do, in each channel and, as the change is antisymmetric, in every mixture of them with real weights.  Plain noise and
/// banks of one channel have one kind; in a bank of two the channels change places.  Channels from the fifth on only turn backwards.
class CarrierBank {
 public:
  static constexpr int kMaxChannels = 256, kNumKinds = 4;
  /// Samples behind the end of each loop, those of its beginning, so that a segment can be read in one piece.
  static constexpr std::size_t kPad = 512;
  /// length: of the loops, a power of two; may be shorter than a response.
  CarrierBank(const BandLayout& bands, float sample_rate_hz, int num_channels, int length, std::uint64_t seed,
              CarrierKind kind = CarrierKind::flattened);
  [[nodiscard]] std::size_t length() const { return length_; }
  [[nodiscard]] int num_channels() const { return num_channels_; }
  [[nodiscard]] int num_kinds() const { return backwards_.loops.empty() ? 1 : kNumKinds; }
  [[nodiscard]] std::span<const float> loop(int band, int channel, int kind = 0) const {
    const Direction& direction = (kind & 1) == 0 ? forwards_ : backwards_;
    const int changed = kind >> 1;
    if (changed != 0 && (channel == 1 || channel == 3) && num_channels_ >= 4) return row(direction.negative, 2 * band + channel / 2);
    return row(direction.loops, num_channels_ * band + (channel < 4 ? channel ^ changed : channel));
  }

 private:
  struct Direction {
    std::vector<float> loops;     ///< [band][channel][length + kPad]
    std::vector<float> negative;  ///< [band][-w, -z][length + kPad]
  };
  [[nodiscard]] std::span<const float> row(const std::vector<float>& samples, int index) const {
    return std::span(samples).subspan(static_cast<std::size_t>(index) * (length_ + kPad), length_);
  }
  void make_kinds(int num_bands);

  std::size_t length_;
  int num_channels_;
  Direction forwards_, backwards_;
};

}  // namespace earshot
