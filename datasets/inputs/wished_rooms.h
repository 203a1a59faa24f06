// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstddef>
#include <cstdint>
#include <memory>
#include <optional>
#include <string>

#include "datasets/rir_corpus_room.h"
#include "sim/acoustics/response/energy_response.h"

namespace earshot {

/// Draws that go on until one fits.  Keeps the number of the one that misses least.
class WishedDraw {
 public:
  [[nodiscard]] bool wants_more(std::uint32_t most) const { return drawn_ < most; }
  /// Number of the draw to make, from 0.
  [[nodiscard]] std::uint32_t next() const { return drawn_; }
  /// Counts the draw and returns `miss`; none: it cannot be used at all.
  std::optional<double> judge(std::optional<double> miss);
  [[nodiscard]] std::optional<std::uint32_t> best() const { return best_; }

 private:
  std::uint32_t drawn_ = 0;
  std::optional<std::uint32_t> best_;
  double least_ = 0;
};

/// The wish for one listener: t20_mid_s within config.rt60_s, and drr_db in the tenth of config.drr_db whose turn it is.  Listeners of a
/// source take the tenths in turn, from a drawn one on.
class WishedListener {
 public:
  static constexpr std::uint32_t kMostDraws = 200;
  WishedListener(const RirCorpusConfig& config, std::size_t room, int source, int listener);
  [[nodiscard]] bool is_asked() const;
  /// How far the ratio lies from its tenth in dB; none outside a range, or where a property has no value.
  [[nodiscard]] std::optional<double> miss(const AcousticScene& acoustics, const EnergyResponse& response) const;
  /// "rt60_s: [0.2, 0.8]".
  [[nodiscard]] std::string text() const;

 private:
  const RirCorpusConfig& config_;
  std::size_t tenth_;
};

/// Loads a room.  With config.rt60_s it is drawn again until the t20_mid_s at its first listener lies in the tenth of the range whose turn
/// it is (room i: tenth i modulo 10), at most 300 times for a shoebox and 50 for a scene; then the room within the range that misses least
/// is taken.  A function of (config, index).  Throws InputError as CorpusRoom, and where no draw lies within the range.
std::shared_ptr<const CorpusRoom> load_wished_room(const RirCorpusConfig& config, std::size_t index, const CorpusRoomSpec& spec);

}  // namespace earshot
