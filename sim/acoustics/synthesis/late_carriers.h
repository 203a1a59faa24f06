#pragma once

#include <cstddef>
#include <cstdint>
#include <optional>
#include <span>
#include <vector>

#include "sim/acoustics/synthesis/carriers.h"
#include "sim/acoustics/synthesis/late_envelope.h"

namespace earshot {

/// Noise of one source at one place: where the loops of a bank are read at each time of a response.
///
/// Space is divided into cells, a lattice that each source has shifted by a random vector of its own; each cell has noise of its own.  In a
/// zone of kBorderM around a face between two cells a response takes its beginning from one and its end from the other, divided by energy:
/// half of it each on the face itself.  So at any time but one bin the noise is that of one cell: it stays flat (carriers.h), as no sum of
/// two noises would, and costs one read.  The mean correlation of two places d apart along a horizontal axis is 1 - d / kCellM in all
/// bands, which is the sin(k d) / (k d) of a diffuse field at 250 Hz for 0.2 m, where both are 0.86.  Places more than kCellM + kBorderM
/// apart along an axis have independent noise.  Where it passes from one cell to the other the noise is not flat: over places the octave
/// T20 of a render scatters by 2.4 % instead of 1.1 % (mono, docs/estimators.md, section 6).
///
/// A response no longer than the loops holds no repeat: a cell that takes over begins to read where the one before would have come only
/// later.  In longer responses the noise of a cell is made of pieces of kPieceS in an order of its own; none comes twice before all have
/// come, and those that come again do so after different times.
/// Owns scratch: one per thread; no allocation once warm.
class LateCarriers {
 public:
  static constexpr float kCellM = 1.4f, kCellHeightM = 2.8f, kBorderM = 0.28f;
  static constexpr double kPieceS = 0.25;
  /// num_samples: of the longest response.  loop_length: of the bank.
  LateCarriers(float sample_rate_hz, int num_samples, std::size_t loop_length, std::uint64_t seed);
  /// stream: noises of one source that must be independent of each other have different ones.  envelope: must stay until the last read.
  /// Costs about 1 us.
  void set(const CarrierKey& key, std::uint32_t stream, const LateEnvelope& envelope);

  /// Part of a segment that comes from one place in the loops.
  struct Read {
    std::size_t in_loop;  ///< of the segment's first sample; the loops go on for CarrierBank::kPad samples behind their end
    float left, right;    ///< fractions of the energy at the ends of the segment; those of all reads add up to one
    [[nodiscard]] bool whole() const { return left == 1.f && right == 1.f; }
  };
  /// Mostly one, two or more at borders.  Valid until the next call.
  std::span<const Read> reads(const LateSegment& segment);

 private:
  /// Noise of one cell, and the fraction of the response's energy that comes before its part.
  struct Cell {
    std::uint64_t hash;
    int order;  ///< the parities of its three indices
    float begin, end;
  };
  void split_axis(float position, float border, std::uint32_t axis, bool orders);
  [[nodiscard]] std::size_t place(const Cell& cell, std::size_t piece, std::size_t sample) const;
  void add(const LateSegment& segment, std::size_t cell, std::size_t piece, float left, float right);

  std::size_t loop_length_, piece_samples_;  ///< the latter 0: one piece
  std::uint64_t seed_, start_ = 0;
  std::uint32_t stream_ = 0;
  std::vector<Cell> cells_, split_;      ///< in the order of time
  std::vector<float> before_;            ///< energy before each merged bin, of the whole
  std::vector<std::size_t> first_cell_;  ///< of each merged bin
  std::vector<std::size_t> piece_;       ///< of the middle of each merged bin
  std::vector<Read> reads_;
};

}  // namespace earshot
