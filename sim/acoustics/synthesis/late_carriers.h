// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstddef>
#include <cstdint>
#include <optional>
#include <span>
#include <vector>

#include "sim/acoustics/synthesis/carriers.h"
#include "sim/acoustics/synthesis/late_envelope.h"

namespace earshot {

/// Noise of one source at one place: which loops of a bank are read at each time of a response, and where.
///
/// Space is divided into cells, a lattice that each source has shifted by a random vector of its own; each cell reads loops of its own
/// choice from a place of its own.  In a zone of kBorderM around a face between two cells a response takes its beginning from one and its
/// end from the other, divided by energy: half of it each on the face itself.  So at any time but one bin the noise is that of one cell: it
/// stays flat (carriers.h), as no sum of two noises would, and costs one read.  The mean correlation of two places d apart along a
/// horizontal axis is 1 - d / kCellM in all bands, which is the sin(k d) / (k d) of a diffuse field at 250 Hz for 0.2 m, where both are
/// 0.86; at 500 Hz a diffuse field has 0.53 there.  (Bands with lattices of their own would follow it, but their noises would not be flat
/// where they overlap: octave T20 at an ear 2.9 % rms for 1.9 %.)  Where the noise passes from one cell to the other it is not flat:
/// docs/explanation/estimators.md, section 6, has what that costs.
///
/// Places more than kCellM + kBorderM apart along an axis, and two sources, have noise of their own: loops of one of four kinds
/// (carriers.h), from a place anywhere in them.  What two of them share by chance, shifted, shows from 1 kHz on, where chance
/// alone is small: over all lags 10 to 15 % of pairs correlate more than 5 % of pairs of independent noise do.
///
/// A response holds no repeat in its first four channels: cells that touch have different kinds, and the binaural tail reads apart()
/// further on.  Limits, where chance may let a part come again: near the corner of a cell, where a response takes from all eight around it,
/// every kind comes twice; so it does where a zone of the listener meets one of a moving source; and responses longer than 15/16 of a loop
/// (3.8 s at 16 kHz) take the kinds in turn, so that each has come after four rounds, 15 s. Owns scratch: one per thread; no allocation
/// once warm.
class LateCarriers {
 public:
  static constexpr float kCellM = 1.4f, kCellHeightM = 2.8f, kBorderM = 0.28f;
  /// bank: describes what is to be read.  num_samples: of the longest response.
  LateCarriers(int num_samples, const CarrierBank& bank, std::uint64_t seed);
  /// By so much later a part of a response reads that must be independent of what the same time of the response has read otherwise: longer
  /// than any fade from one to the other, so that nothing is read twice.
  [[nodiscard]] std::size_t apart() const { return apart_; }
  /// stream: noises of one source that must be independent of each other have different ones.  envelope: must stay until the last read.
  /// ahead: 0 or apart().  Costs about 1 us.
  void set(const CarrierKey& key, std::uint32_t stream, const LateEnvelope& envelope, std::size_t ahead = 0);

  /// Part of a segment that comes from one place in the loops.
  struct Read {
    int kind;
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
    std::uint32_t kind;  ///< by the parities of its indices: cells that touch have different ones
    float begin, end;
  };
  void split_axis(float position, float border, std::uint32_t axis, std::uint32_t parity);
  [[nodiscard]] Read place(const Cell& cell, std::size_t round, std::size_t sample) const;
  void add(const LateSegment& segment, std::size_t cell, std::size_t round, float left, float right);

  int num_kinds_;
  std::size_t loop_length_, apart_, round_samples_ = 0;  ///< the latter 0: a loop is longer than any response
  std::uint64_t seed_;
  std::size_t ahead_ = 0;
  std::vector<Cell> cells_, split_;      ///< in the order of time
  std::vector<float> before_;            ///< energy before each merged bin, of the whole
  std::vector<std::size_t> first_cell_;  ///< of each merged bin
  std::vector<std::size_t> round_;       ///< of the middle of each merged bin
  std::vector<Read> reads_;
};

}  // namespace earshot
