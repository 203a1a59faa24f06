// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <bit>
#include <cstddef>
#include <cstdint>
#include <span>

#include "sim/acoustics/core/widening_bins.h"
#include "sim/acoustics/model/acoustic_scene.h"

/// Layout of a source field's bytes.  Internal to the source field.
namespace earshot {

/// The image: this, then [num_cells] FieldEntry, then the values of all entries, each [merged bins of the entry][coefficients][padded
/// bands].
struct FieldHeader {
  static constexpr std::uint64_t kMagic = 0x33444C4546524145u;  // "EARFELD3"
  std::uint64_t magic = kMagic;
  std::uint64_t key = 0;    ///< source_field_key
  std::uint64_t bytes = 0;  ///< of the whole image
  std::uint64_t photons = 0;
  std::uint64_t num_values = 0;
  std::uint32_t num_cells = 0, num_bins = 0, num_coefficients = 0, padded_bands = 0;
  double bin_s = 0, t20_error = 0;
  std::uint64_t nonfinite_dropped = 0;
};

/// Time axis of the histories in a scene: single bins from where sound that crosses the scene arrives.
WideningBins field_bins(const AcousticScene& scene, int num_bins);

/// History of a cell: merged bins (widening_bins.h) `first` to `first + count - 1` may differ from zero.
struct FieldEntry {
  std::uint32_t first = 0, count = 0;
  std::uint64_t offset = 0;  ///< of its first value, in values
};

/// Values are the upper halves of floats (bfloat16): the range of a float, at most 0.4 % of rounding each, half the memory traffic.
using FieldValue = std::uint16_t;

inline FieldValue to_field_value(float value) {
  const auto bits = std::bit_cast<std::uint32_t>(value);  // finite; to nearest, ties to even
  return static_cast<FieldValue>((bits + 0x7FFFu + ((bits >> 16) & 1u)) >> 16);
}
inline float from_field_value(FieldValue value) { return std::bit_cast<float>(std::uint32_t{value} << 16); }

}  // namespace earshot
