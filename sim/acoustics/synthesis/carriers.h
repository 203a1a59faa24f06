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

/// Key of a source by position: its noise is the same in every episode and for every agent.
std::uint64_t carrier_key(std::uint64_t scene_hash, glm::vec3 source_position);
/// By number: a source that moves keeps its key, and sources at one position have different noise.
std::uint64_t carrier_key(std::uint64_t scene_hash, std::size_t source_number = 0);

/// plain: noise that is not flattened, for sums of so many channels that flattening would be lost; quick to make.
enum class CarrierKind { flattened, plain };

/// Noise on which late energy rides: one loop per band and channel, seeded.  The bands of a channel are cut from one white noise of unit
/// variance by BandFilters, so they add up to it again: bands of equal energy give the same white tail for every number of bands
/// (docs/oracles.md, O-31: one carrier, amplitude-complementary filters).  Channels are independent. The price: where neighbouring bands
/// differ, the crossover between them follows their amplitudes, not their energies.  At 3 dB per octave that takes 0.03 dB off the sum, at
/// 10 dB 0.3 dB, and 0.6 dB off an octave that stands alone.
///
/// The noise is flattened (docs/estimators.md, section 6): in every octave its power averaged over about 2 / bandwidth is nearly constant,
/// so that the decay of a rendered response is that of its energy.  Flattening each channel alone would be lost where channels are mixed,
/// as they are in the ears; the first four channels are therefore flattened together, so that every mixture of them is flat.  Further ones,
/// which only ambisonics above first order have, are flattened alone.
class CarrierBank {
 public:
  static constexpr int kMaxChannels = 256;
  /// Samples behind the end of each loop, those of its beginning, so that a segment can be read in one piece.
  static constexpr std::size_t kPad = 512;
  /// length: of the loops, a power of two; may be shorter than a response.
  CarrierBank(const BandLayout& bands, float sample_rate_hz, int num_channels, int length, std::uint64_t seed,
              CarrierKind kind = CarrierKind::flattened);
  [[nodiscard]] std::size_t length() const { return length_; }
  [[nodiscard]] int num_channels() const { return num_channels_; }
  [[nodiscard]] std::span<const float> loop(int band, int channel) const {
    return std::span(samples_).subspan(
        (static_cast<std::size_t>(band) * static_cast<std::size_t>(num_channels_) + static_cast<std::size_t>(channel)) * (length_ + kPad),
        length_);
  }

 private:
  std::size_t length_;
  int num_channels_;
  std::vector<float> samples_;  ///< [band][channel][length + kPad]
};

}  // namespace earshot
