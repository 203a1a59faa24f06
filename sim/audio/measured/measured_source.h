// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <complex>
#include <cstddef>
#include <glm/vec3.hpp>
#include <string>
#include <string_view>
#include <vector>

namespace earshot {

/// Sound pressure around a source in a free field, as a file holds it.
struct MeasuredSource {
  static constexpr std::size_t kMaxDirections = 100000, kMaxFrequencies = 65536, kMaxValues = std::size_t{1} << 24;
  std::vector<double> frequency_hz;           ///< [F], positive, rising
  std::vector<glm::vec3> direction;           ///< [D], unit, axes of the source: x right, y up, -z front; copies of a direction may occur
  std::vector<std::complex<float>> pressure;  ///< [D][F], brought to one distance, any scale
};

/// Throws InputError naming `where` unless the lists have sizes in range that agree, and all numbers are finite and in range.
void validate(const MeasuredSource& source, const std::string& where);

/// As bytes, for the answer of another process.  decode_source throws InputError for bytes that do not decode to a valid source.
std::string encode_source(const MeasuredSource& source);
MeasuredSource decode_source(std::string_view bytes, const std::string& where);

}  // namespace earshot
