// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <array>
#include <cstdint>
#include <memory>
#include <span>
#include <vector>

#include "sim/acoustics/response/energy_response.h"
#include "sim/acoustics/synthesis/carriers.h"
#include "sim/acoustics/synthesis/late_envelope.h"
#include "sim/audio/head/hrtf.h"
#include "sim/audio/head/listener_layout.h"
#include "sim/audio/head/listener_orientation.h"

namespace earshot {

/// Impulse response: channels one after the other, [num_channels, num_samples], pressure in Green units (unit source).
struct Rir {
  int num_channels = 0, num_samples = 0;
  float sample_rate_hz = 0;
  std::vector<float> samples;
  std::uint32_t channel_mask = 0;  ///< ListenerLayout::channel_mask
  [[nodiscard]] std::span<const float> channel(int index) const {
    return std::span(samples).subspan(static_cast<std::size_t>(index) * num_samples, num_samples);
  }
};

/// Tables of the synthesis, common to all agents: band filters, seeded flattened carriers, head filters, noise for two ears.  Immutable.
/// Making it for half a second at 16 kHz takes about half a second of one core (bands in parallel), 0.1 s more for each ambisonic channel
/// above first order; arrays that are not in one place take 50 MB and more.  hrtf: for binaural only, null means the rigid sphere.  layout:
/// a ChannelLayout converts. Throws InputError.
class SynthesisTables;
std::shared_ptr<const SynthesisTables> make_synthesis_tables(const AcousticConfig& config, const BandLayout& bands,
                                                             const ListenerLayout& layout, std::shared_ptr<const Hrtf> hrtf);

/// Late sound of one response, before any head: cached for a listener that turns without moving.  Starts empty.
class LateSound {
 public:
  void forget() { known_ = false; }

 private:
  friend class RirSynthesizer;
  bool known_ = false;
  LateEnvelope envelope_;
  int num_decoded_ = 0;                         ///< bins that are decoded, from 0 on
  std::size_t sounding_ = 0;                    ///< samples that those reach
  std::array<std::vector<float>, 4> channels_;  ///< of those: N3D, world axes
};

/// Renders energy responses to pressure (docs/explanation/estimators.md, section 6): arrivals as fractional-delay impulses through band
/// gains and phases and what the layout makes of their direction, the late field as the square root of its energy on carriers.  A response
/// whose bands hold equal energy e gives a flat spectrum and sum h^2 = e.  Sample n is time n / rate after emission, at the listener's
/// position; what a head or a filter rings before sample 0 is cut, arrivals past the end are dropped, and no late sound precedes the direct
/// sound.
///  - binaural: the head's filters of each direction; the late field with its first-order moments, decoded at first order up to
///    late_decode_s, from there as in binaural_late_tail.h.
///  - ambisonics: harmonics of each direction; the late field with the moments that the histogram holds, diffuse above them.
///  - array: each arrival as a spherical wave from its image (distance times direction), so with the exact delay, level and angle at each
///    microphone.  The late field of first-order patterns in one place is that of first-order ambisonics, mixed; of others as in
///    late_array.h.  Low-passes of microphones come last.
/// Owns scratch: one per thread.  No allocation per call once warm; 0.2 ms for 1.5 s binaural at 16 kHz with ten arrivals; about 0.1 s for
/// arrays that are not in one place.
class RirSynthesizer {
 public:
  explicit RirSynthesizer(std::shared_ptr<const SynthesisTables> tables);
  ~RirSynthesizer();
  RirSynthesizer(RirSynthesizer&&) noexcept;

  /// orientation: of the listener; a heading in radians converts.  key: whose noise the late field rides on, and where it is heard.
  /// rir: resized to the length of the late field, round(num_bins * bin_s * rate).  It has
  /// that of the tables, round(rir_length_s * rate), where that is shorter or less than a bin longer, without a late field and for arrays
  /// that are not in one place.
  /// response.late: no bins, or the bands of the tables and any SH order; order 0 counts as diffuse.
  /// cached: null, or of this response and key, or forgotten: saves a quarter of the time of further renders for two ears or for an array
  /// in one place, and changes no bit.
  /// left_out: empty, or for each arrival whether it is left out, because it is heard otherwise (path_glide.h); late sound still begins
  /// with the direct sound.
  void render(const EnergyResponse& response, const ListenerOrientation& orientation, const CarrierKey& key, Rir& rir,
              LateSound* cached = nullptr, std::span<const std::uint8_t> left_out = {});

 private:
  struct Scratch;
  struct Pass;
  const LateSound& first_order_sound(const Pass& pass, double onset_sample, std::size_t length);
  void mix_late(const LateSound& sound, const ListenerOrientation& orientation, Rir& rir);
  void render_late(const Pass& pass, double onset_sample, Rir& rir);
  void add_arrival(const Pass& pass, const Arrival& arrival, Rir& rir);
  void add_to_ears(const Pass& pass, const Arrival& arrival, double delay_samples, Rir& rir);
  void add_to_harmonics(const Pass& pass, const Arrival& arrival, double delay_samples, Rir& rir);
  void add_to_microphones(const Pass& pass, const Arrival& arrival, Rir& rir);
  void add_impulse(double delay_samples, std::size_t channel, Rir& rir);
  using FirstOrder = std::array<std::span<const float>, 4>;
  FirstOrder rotate_first_order(const ListenerOrientation& orientation, const LateSound& sound);
  [[nodiscard]] int count_samples(const EnergyHistogram& late) const;
  void decode_late(const FirstOrder& field, Rir& rir);

  std::shared_ptr<const SynthesisTables> tables_;
  std::unique_ptr<Scratch> scratch_;
};

}  // namespace earshot
