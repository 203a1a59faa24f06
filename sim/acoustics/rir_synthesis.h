#pragma once

#include <cstdint>
#include <memory>
#include <span>
#include <vector>

#include "sim/acoustics/rir.h"
#include "sim/audio/hrtf.h"

namespace earshot {

enum class ChannelLayout { mono, binaural };

/// Impulse response: channels one after the other, [num_channels, num_samples], pressure in Green units (unit source).
struct Rir {
  int num_channels = 0, num_samples = 0;
  float sample_rate_hz = 0;
  std::vector<float> samples;
  [[nodiscard]] std::span<const float> channel(int index) const {
    return std::span(samples).subspan(static_cast<std::size_t>(index) * num_samples, num_samples);
  }
};

/// What synthesis shares between agents: band filters, seeded flattened carriers (ORACLES 2.6), head filters.  Immutable.
class SynthesisTables;
std::shared_ptr<const SynthesisTables> make_synthesis_tables(const AcousticConfig& config, const BandLayout& bands,
                                                            ChannelLayout layout, std::shared_ptr<const Hrtf> hrtf);

/// Renders energy responses to pressure.  Owns scratch: one per thread.  No allocation per call once warm.
class RirSynthesizer {
 public:
  explicit RirSynthesizer(std::shared_ptr<const SynthesisTables> tables);
  ~RirSynthesizer();
  RirSynthesizer(RirSynthesizer&&) noexcept;

  /// heading_rad: of the listener (binaural).  carrier_key: identifies the source, so that its noise stays the same from
  /// step to step and differs between sources.  rir: resized to the configured length.
  void render(const EnergyResponse& response, double heading_rad, std::uint64_t carrier_key, Rir& rir);

 private:
  struct Scratch;
  std::shared_ptr<const SynthesisTables> tables_;
  std::unique_ptr<Scratch> scratch_;
};

}  // namespace earshot
